"""An environment's material: what other code made is refused, a model of other data or options is trained anew."""

from dataclasses import replace

import pytest
from support.experiment_samples import NETWORK, TINY, times, tiny

from nas_data.errors import OutputExists
from nas_data.models.run import STATE
from nas_data.runs.stages import read_stage
from nas_data.simulators import mujoco
from nas_data.studies.experiments.pipeline.artifacts import PHI, Artifacts
from nas_data.studies.experiments.pipeline.learning import ModelJob, train_model


@pytest.fixture(scope="module")
def material(tmp_path_factory) -> Artifacts:
    """Recordings of Pusher and a φ, tiny."""
    return tiny(tmp_path_factory.mktemp("material"), "Pusher").material("Pusher", (PHI,))


def job(material, folder, **options):
    return ModelJob("delta", material.train, replace(NETWORK, **options), folder / "phi")


def silent(_):
    pass


def again(material):
    request = tiny(material.folder.parents[2], "Pusher")
    assert request.home("Pusher") / request.purpose == material.folder
    return request.material("Pusher", (PHI,))


@pytest.mark.parametrize(
    ("module", "old", "new", "stage"),
    [
        ("nas_data.envs.pusher", "START_ANGLE = 0.1", "START_ANGLE = 0.2", "Record and pair"),
        ("nas_data.recorders.recipe", "seed: int = 0", "seed: int = 1", "Record and pair"),
        ("nas_data.models.optimiser", "class Optimiser", "later = 1\nclass Optimiser", "Learn φ"),
    ],
)
def test_what_other_code_made_is_refused_and_left_alone(material, edited, module, old, new, stage):
    before = times(material.folder)
    edited(module, old, new)
    with pytest.raises(OutputExists, match=f"'{stage}' in .* was made by another version"):
        again(material)
    assert times(material.folder) == before


def test_code_of_another_environment_and_of_naming_does_not_matter_here(material, edited):
    before = times(material.folder)
    edited("nas_data.envs.ergo_reacher", "horizon=", "period=1.0, horizon=")
    edited("nas_data.gap.floor", "import numpy as np", "import numpy as np\nlater = 1")
    again(material)
    assert times(material.folder) == before


def test_a_stage_says_who_did_it_and_what_it_cost(material):
    done = read_stage(PHI, material.folder)
    assert len(done.code) == 64
    assert done.cpu_seconds > 0
    assert done.commit is None or len(done.commit) >= 40


def test_a_model_of_other_options_is_trained_anew_and_the_same_is_kept(material, tmp_path):
    said = []
    train_model(job(material, tmp_path), said.append)
    before = times(tmp_path)
    train_model(job(material, tmp_path), said.append)
    assert times(tmp_path) == before
    rows = train_model(job(material, tmp_path, updates=2), said.append)
    assert rows[-1]["update"] == 2
    assert any("differs in options: it is trained again" in line for line in said)


def test_a_model_of_other_trajectories_is_trained_anew(material, tmp_path):
    said = []
    train_model(job(material, tmp_path), said.append)
    train_model(job(material, tmp_path), said.append, lambda whole: whole.select(range(TINY.trajectories // 2)))
    assert any("differs in learned_from" in line for line in said)


def test_an_unfinished_model_of_other_options_is_begun_anew(material, tmp_path):
    class Cut(Exception):
        pass

    def cut(line):
        raise Cut

    with pytest.raises(Cut):
        train_model(job(material, tmp_path), cut)
    (tmp_path / "phi" / STATE).touch()
    assert train_model(job(material, tmp_path, updates=2), silent)[-1]["update"] == 2


@pytest.mark.parametrize(("threads", "expected"), [(1, 1), (3, 3)])
def test_the_source_of_a_model_is_simulated_on_the_threads_asked_for(
    material, tmp_path, monkeypatch, threads, expected
):
    seen = []
    original = mujoco.MujocoSimulator.__init__

    def noted(self, *arguments):
        original(self, *arguments)
        seen.append(self.threads)

    monkeypatch.setattr(mujoco.MujocoSimulator, "__init__", noted)
    train_model(replace(job(material, tmp_path), threads=threads), silent)
    assert set(seen) == {expected}
