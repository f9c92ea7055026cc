"""Checks of a sweep's plan before it starts."""

from nas_data import registry
from nas_data.dataset.content import hash_episodes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE
from nas_data.dataset.versions import check_paired
from nas_data.errors import DatasetInvalid, JointMismatch, ModelFileError, OptionError
from nas_data.pairing import check_fits, check_source
from nas_data.simulators.engines import ENGINES
from nas_data.sources import SourceModel
from nas_data.studies.ablation.kinds.base import FOLDER, ModelKind, find_kind
from nas_data.studies.ablation.naming import read_named
from nas_data.studies.ablation.subsets import check_enough
from nas_data.studies.ablation.sweep import SweepPlan


def check(plan: SweepPlan) -> None:
    """Refuse a plan that cannot be run.

    Raises:
        NasError: says what is wrong, and the remedy.
    """
    check_seeds(plan)
    if not plan.kinds:
        raise OptionError(
            f"--kinds names none; give some of {', '.join(registry.list_names(FOLDER))}, with commas between."
        )
    kinds = {name: find_kind(name) for name in plan.kinds}
    dataset = plan.material.read()
    check_held_out(plan, dataset)
    check_sources(plan, dataset, kinds)
    for seed in plan.seeds:
        train, held = plan.material.divide(dataset, plan.held_out, seed)
        for amount in plan.amounts:
            check_enough(dataset, train, amount)
        if plan.material.test is not None:
            check_test(plan, dataset, held)


def check_seeds(plan: SweepPlan) -> None:
    """Refuse negative and repeated seeds."""
    if not plan.seeds or min(plan.seeds) < 0 or len(set(plan.seeds)) < len(plan.seeds):
        raise OptionError(f"--seeds are {', '.join(map(str, plan.seeds))}; give different numbers, 0 or more.")


def check_held_out(plan: SweepPlan, dataset: Dataset) -> None:
    """Refuse a share out of range, and a single episode, which cannot be both training and held-out data."""
    if plan.held_out is None:
        return
    if not 0 < plan.held_out < 1:
        raise OptionError(f"--held-out is {plan.held_out:g}; it must lie between 0 and 1, for example 0.2.")
    if dataset.n_episodes < 2:
        raise DatasetInvalid(
            f"{plan.material.root} has one episode, which cannot both train and judge; "
            "record more, or give another dataset that judges: --test DATASET."
        )


def check_sources(plan: SweepPlan, dataset: Dataset, kinds: dict[str, ModelKind]) -> None:
    """Refuse kinds without the source or the pairs that they need."""
    material, source = plan.material, plan.material.source()
    for name, kind in kinds.items():
        if kind.needs_pairs:
            check_paired(material.root, dataset, f"The kind {name}", ", or leave it out (--kinds forward)")
        if kind.needs_source and source is None:
            raise ModelFileError(
                f"The kind {name} needs a source, and {material.root} keeps none; give --model MODEL.xml."
            )
        if kind.names and source is not None:
            check_naming(plan, dataset, source, name)
    if source is not None:
        simulator = source.simulator(dataset, threads=1)
        pairs = any(kind.needs_pairs for kind in kinds.values())
        (check_source if pairs else check_fits)(dataset, simulator)


def check_naming(plan: SweepPlan, dataset: Dataset, source: SourceModel, kind: str) -> None:
    """Refuse a source that naming does not support, and given effects of another robot."""
    if plan.material.effects is not None:
        read_named(plan.material.effects, source, dataset)
    elif source.engine != ENGINES[0] or source.effects:
        what = f"runs in {source.engine}" if source.engine != ENGINES[0] else "has effects already"
        raise ModelFileError(
            f"The source of {plan.material.root} {what}, and the kind {kind} names effects in a plain model in MuJoCo; "
            "give one with --model, or effects of a gap report with --effects."
        )


def check_test(plan: SweepPlan, dataset: Dataset, test: Dataset) -> None:
    """Refuse a test dataset of another robot, or one that shares episodes with the training data."""
    name = plan.material.test
    mine, other = ((d.joints, d.kinds, round(d.fps, 1)) for d in (dataset, test))
    if mine != other:
        raise JointMismatch(
            f"{name} cannot judge: its joints, kind of command or rate ({', '.join(other[0])}; {other[2]:g} Hz) are "
            f"not those of {plan.material.root} ({', '.join(mine[0])}; {mine[2]:g} Hz)."
        )
    trained = {digest: place for place, digest in enumerate(hash_episodes(dataset, (STATE, ACTION)))}
    for place, digest in enumerate(hash_episodes(test, (STATE, ACTION))):
        if digest in trained:
            raise DatasetInvalid(
                f"Episode {place} of {name} is episode {trained[digest]} of {plan.material.root}: what judges must not "
                "train; divide the dataset with `nas split`."
            )
