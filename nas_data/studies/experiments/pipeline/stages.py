"""Stages that build an environment's artifacts: record and pair, train φ and ψ, name, train φ on the names."""

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

from nas_data.count_of import count_of
from nas_data.dataset import versions
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.gap import workflow
from nas_data.gap.model_correction import ModelCorrection
from nas_data.models.lstm import Kind
from nas_data.runs.code_hash import hash_code, list_effect_modules, list_gap_modules
from nas_data.runs.parallel import Workers
from nas_data.runs.progress import RateLimited, Report
from nas_data.runs.stages import (
    INDENT,
    Part,
    Stage,
    StageResult,
    Work,
    do_part,
    read_done,
    run_side_by_side,
    run_stages,
)
from nas_data.studies.experiments.pipeline.artifacts import (
    DATASETS,
    HELDOUT,
    NAMED,
    NAMES,
    PHI,
    PHI_NAMED,
    PSI,
    TRAIN,
    Artifacts,
    MaterialPlan,
)
from nas_data.studies.experiments.pipeline.learning import ModelJob, train_model
from nas_data.studies.experiments.pipeline.pairs import Predictor, pair_again, record_and_pair

Job = Work[MaterialPlan]

FOLDER = "folder of recordings and models"  # name of the work in messages
PAUSE = 15.0  # [s] between two progress lines of the search
STORED_ENTRIES = ("verdict", "effects", "retuned", "gap")  # entries of a gap report that are stored with the stage


def record(job: Job) -> StageResult:
    """Record training and held-out data, and pair both with the source."""
    plan = job.plan
    source = Predictor.of(plan.recipe.environment, plan.source)
    held = replace(plan.recipe, episodes=plan.heldout, seed=plan.recipe.seed + 1)
    found = {
        name: record_and_pair(recipe, source, name, job.folder, DATASETS)
        for name, recipe in ((TRAIN, plan.recipe), (HELDOUT, held))
    }
    texts = [
        f"{count_of(one.episodes, 'episode')}, {count_of(one.frames, 'transition', ',')} → {job.folder / one.path}"
        for one in found.values()
    ]
    return StageResult(texts, {name: one.describe() for name, one in found.items()})


def make_learner(kind: Kind, name: str, folder: str) -> Callable[[Job], StageResult]:
    """Return a function that trains a model of a kind on the pairs."""

    def learn(job: Job) -> StageResult:
        options = job.plan.delta if kind == "delta" else job.plan.forward
        pairs = Artifacts(job.plan, job.folder).train
        return run_training(ModelJob(kind, pairs, options, job.folder / folder, job.threads), name, job)

    return learn


def run_training(model: ModelJob, name: str, job: Job) -> StageResult:
    """Train a model; return its result as a sentence."""
    history = train_model(model, lambda line: job.report(f"{INDENT}{name}  {line}"))
    return StageResult([f"{name} → {model.folder}"], {"validations": len(history), "options": vars(model.options)})


def name_effects(job: Job) -> StageResult:
    """Run `nas gap` on the recordings alone, without knowledge of the target."""
    material = Artifacts(job.plan, job.folder)
    root = select_recordings(job)
    say = RateLimited(lambda line: job.report(f"{INDENT}names  {line.strip()}"), PAUSE)
    report = workflow.investigate(root, material.train / "meta/source.xml", job.folder / NAMES, say)
    named = ModelCorrection.read(job.folder / NAMES)
    listed = ", ".join(f"{effect.name()} in {effect.joint or 'the arm'}" for effect in named.effects) or "nothing"
    content = report.to_json()
    return StageResult(
        [f"named: {listed}; {report.verdict} → {job.folder / NAMES}"], {key: content[key] for key in STORED_ENTRIES}
    )


def select_recordings(job: Job) -> Path:
    """Return the folder of the input of `nas gap`: all recorded episodes, or the first ones."""
    train = Artifacts(job.plan, job.folder).train
    dataset, provenance = read(train), read_provenance(train)
    if job.plan.named is None or job.plan.named >= dataset.n_episodes or provenance is None:
        return train
    return versions.write_version(dataset.select(range(job.plan.named)), "to_name", provenance, job.folder / DATASETS)


def learn_on_names(job: Job) -> StageResult:
    """Pair the recordings with the source and its named effects, and train φ on the residual."""
    material, plan = Artifacts(job.plan, job.folder), job.plan
    if material.named is None or material.explained:
        (job.folder / PHI_NAMED).mkdir(exist_ok=True)
        nothing = "no effect was named: φ on the named source is φ"
        explained = (
            "the error with the named effects is at the noise floor: φ has nothing to learn there and is left out"
        )
        return StageResult([nothing if material.named is None else explained], {})
    pairs = pair_again(material.train, plan.source_with(material.named), NAMED, job.folder, DATASETS)
    model = ModelJob("delta", job.folder / pairs.path, plan.delta, job.folder / PHI_NAMED, job.threads)
    return run_training(model, "φ on the named source", job)


def list_source_modules(plan: MaterialPlan) -> tuple[str, ...]:
    """Return the modules that determine the source's motion."""
    return DynamicsSpec(plan.recipe.environment, plan.source).modules()


def hash_recording_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that records the target and pairs it with the source."""
    recipe = plan.recipe
    target = DynamicsSpec(recipe.environment, recipe.dynamics, engine=recipe.engine).modules()
    return hash_code(*target, *list_source_modules(plan), "nas_data.studies.experiments.pipeline.pairs")


def hash_learning_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that trains φ and ψ."""
    return hash_code(*list_source_modules(plan), "nas_data.models.run")


def hash_naming_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that names effects: the search and all effects."""
    return hash_code(*list_source_modules(plan), *list_gap_modules())


def hash_named_learning_code(plan: MaterialPlan) -> str:
    """Return the hash of the code that pairs the source with named effects, and trains φ on it."""
    pairing = (*list_effect_modules(), "nas_data.gap.model_correction", "nas_data.studies.experiments.pipeline.pairs")
    return hash_code(*list_source_modules(plan), *pairing, "nas_data.models.run")


STAGES = {  # in parallel runs, stages with dependents come first, then the longest ones
    stage.name: stage
    for stage in (
        Stage(
            "record",
            "Record and pair",
            "The environment's target is driven by random actions (brief, long, weak or smooth, by episode) from the "
            "environment's own initial states, with its objects; the source then predicts every transition.",
            record,
            (DATASETS,),
            (),
            hash_recording_code,
        ),
        Stage(
            NAMES,
            "Name what is missing",
            "`nas gap` compares source and recordings and names the effects that the source lacks.",
            name_effects,
            (NAMES,),
            ("record",),
            hash_naming_code,
        ),
        Stage(
            PHI,
            "Learn φ",
            "φ corrects each step of the source; 'validation' is the error of its own rollouts [rad]; * marks the best "
            "so far, which is kept.",
            make_learner("delta", "φ", PHI),
            (PHI,),
            ("record",),
            hash_learning_code,
        ),
        Stage(
            PHI_NAMED,
            "Learn φ on the named source",
            "Another φ corrects the source with the named effects, if an error above the noise floor remains.",
            learn_on_names,
            (PHI_NAMED,),
            ("record", NAMES),
            hash_named_learning_code,
        ),
        Stage(
            PSI,
            "Learn ψ",
            "ψ predicts each step without a simulator.",
            make_learner("forward", "ψ", PSI),
            (PSI,),
            ("record",),
            hash_learning_code,
        ),
    )
}


def describe_stages(material: Artifacts) -> dict[str, object]:
    """Return cost, time and commit of each finished stage for JSON."""
    keys = ("seconds", "cpu_seconds", "when", "load", "commit")
    found = {name: read_done(stage, material.folder) for name, stage in STAGES.items()}
    return {name: {key: getattr(done, key) for key in keys} for name, done in found.items() if done is not None}


def make_material(
    plan: MaterialPlan, folder: Path, needs: Collection[str], report: Report, workers: Workers
) -> Artifacts:
    """Build the required artifacts of an environment; finished stages are skipped.

    Args:
        plan: Settings of the artifacts.
        folder: Their folder.
        needs: Names of the required stages; their dependencies are added.
        report: Called with lines of progress.
        workers: Where the stages run; several run in processes of their own.

    Raises:
        OutputExists: the folder holds something else, or artifacts of another plan or other code.
        JobsFailed: several stages failed; all others are finished except those that depend on them.
    """
    stages = list_stages(needs)
    work = Work(plan, folder, report, name=FOLDER)
    if workers.one_core:
        run_side_by_side(stages, work, workers, make_part)
    else:
        run_stages(stages, work)
    return Artifacts(plan, folder)


def list_stages(needs: Collection[str]) -> list[Stage[MaterialPlan]]:
    """Return some stages and those that they depend on, in a valid sequential order."""
    wanted = {*needs}.union(*(STAGES[name].builds_on or () for name in needs))
    return [stage for name, stage in STAGES.items() if name in wanted]


def make_part(part: Part[MaterialPlan]) -> None:
    """Run a stage in its own process."""
    do_part(STAGES[part.stage], part)
