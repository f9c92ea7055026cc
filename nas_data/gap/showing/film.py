"""Film of a gap page: measured arm and models before and after in one scene."""

import tempfile
from pathlib import Path

import numpy as np

from nas_data.errors import MissingPackage, ModelFileError
from nas_data.gap.report import GapReport
from nas_data.gap.showing.figures import AFTER, BEFORE, RETUNED
from nas_data.gap.showing.series import Series
from nas_data.gap.write_model import MODEL
from nas_data.joint_units import find_joint_unit
from nas_data.reports.page import Block, ShortFilm, Text

SECONDS = 4.0  # [s] of the episode
RATE = 12  # [Hz] frames per second
SIZE = (360, 440)  # [px] height, width


def make_film_blocks(folder: Path, report: GapReport, series: Series) -> list[Block]:
    """Return the film, or a sentence if it cannot be rendered; empty without a model."""
    if not (folder / MODEL).is_file():
        return []
    try:
        return [draw_film(folder / MODEL, report, series)]
    except MissingPackage as error:
        return [Text(f"No film was made. {error} Then run: nas gap show {folder}")]
    except ModelFileError as error:
        return [Text(f"No film was made. {error}")]


def draw_film(model: Path, report: GapReport, series: Series) -> ShortFilm:
    """Render the part of the held-out episodes with the largest error of the given model.

    Raises:
        MissingPackage: this machine cannot render; names a package.
        ModelFileError: the model cannot be rendered.
    """
    from nas_data.dataset.dataset import Dataset
    from nas_data.dataset.features import POSITION, STATE, Feature
    from nas_data.reports.films.film import Film, write_mp4
    from nas_data.reports.films.motion import MEASURED, Ghost, Motion
    from nas_data.robots.base import find_robot
    from nas_data.simulators.mujoco import MujocoSimulator

    episode, rows = find_worst_stretch(series)
    rate, places = 1 / series.period, [places for _, places in series.kinds]
    body = MujocoSimulator(find_robot(model), series.period, series.joints, threads=1)
    last = AFTER if report.effects else RETUNED
    ghosts = []
    for name, positions in ((MEASURED, series.measured), (BEFORE, series.before), (last, series.after)):
        errors = np.square(positions[episode, rows] - series.measured[episode, rows])
        states = np.concatenate([positions[episode, rows], np.zeros_like(positions[episode, rows])], axis=1)
        each = np.stack([np.sqrt(errors[:, chosen].mean(axis=1)) for chosen in places], axis=1)
        ghosts.append(Ghost(name, body, states, each))
    names = tuple(joint + POSITION for joint in series.joints)
    state = Feature(names, tuple(find_joint_unit(joint, series.slides).si for joint in series.joints))
    shown = series.measured[episode, rows]
    recorded = Dataset({STATE: state}, {STATE: shown[:-1]}, np.array([len(shown) - 1]), rate)
    motion = Motion(int(series.episodes[episode]), recorded, tuple(ghosts))
    with tempfile.TemporaryDirectory() as place:
        film = Film(motion, report.dataset, SIZE)
        try:
            write_mp4(film, np.arange(0, len(shown), rate / RATE).astype(int), RATE, Path(place, "film.mp4"))
        finally:
            film.close()
        mp4 = Path(place, "film.mp4").read_bytes()
    first, end = series.time[rows.start], series.time[rows.stop - 1]
    caption = (
        f"Episode {series.episodes[episode]}, {first:.1f} to {end:.1f} s: the interval with the largest error of the "
        f"given model. Grey: measured. Blue: {BEFORE}. Orange: {last}. Both models receive commands only."
    )
    return ShortFilm(mp4, caption)


def find_worst_stretch(series: Series) -> tuple[int, slice]:
    """Return index and rows of the held-out episode with the largest error of the given model."""
    errors = np.square(series.before - series.measured)[..., series.kinds[0][1]].sum(-1) * series.counts
    length = max(2, min(series.counts.shape[1], round(SECONDS / series.period)))
    sums = np.concatenate([np.zeros((len(errors), 1)), np.cumsum(errors, axis=1)], axis=1)
    episode, start = np.unravel_index(
        np.argmax(sums[:, length:] - sums[:, :-length]), (len(sums), sums.shape[1] - length)
    )
    end = min(int(start) + length, int(series.counts[episode].sum()))
    return int(episode), slice(max(0, end - length), end)
