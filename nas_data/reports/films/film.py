"""Pictures and films of ghosts, with a caption that names each ghost and its error."""

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from nas_data.atomic_file import write_atomic
from nas_data.errors import OptionError
from nas_data.reports.films.motion import Motion
from nas_data.reports.films.scene import Scene, choose_colour
from nas_data.simulators.offscreen import OffscreenRenderer

LINE, EDGE = 22, 10  # [px] height of a caption line, and margin around it
TYPE_SIZE = 15  # [px]
CODECS = ("libx264", "libopenh264", "mpeg4")  # in order of preference
QUALITY = {"libx264": {"crf": "20", "preset": "medium"}}
INK, PAPER = (30, 30, 35), (255, 255, 255)


class Film:
    """Renderer of an episode's pictures."""

    def __init__(
        self, motion: Motion, title: str, size: tuple[int, int], azimuth: float = 120.0, elevation: float = -15.0
    ) -> None:
        """Compose the scene and open the renderer.

        Args:
            motion: Motion of the ghosts.
            title: Start of the caption.
            size: Height and width of a picture with its caption [px]; even numbers.
            azimuth: Azimuth of the camera's view [deg].
            elevation: Elevation of the camera's view [deg].

        Raises:
            OptionError: a picture of that size is too small or too large, or an angle is no number.
            MissingPackage: this machine cannot render; names a package.
            ModelFileError: the models cannot be combined in one scene.
        """
        self.motion, self.title, self.size = motion, title, size
        self._strip = 2 * EDGE + LINE * (1 + len(motion.ghosts))
        height = size[0] - self._strip
        if height < self._strip or size[1] < size[0] // 2 or size[0] % 2 or size[1] % 2:
            raise OptionError(
                f"A picture of {size[1]} × {size[0]} pixels has no room for {len(motion.ghosts)} arms and their "
                "caption; give even numbers such as --width 960 --height 720."
            )
        for name, angle in (("azimuth", azimuth), ("elevation", elevation)):
            if not np.isfinite(angle):
                raise OptionError(f"--{name} {angle:g} must be a number of degrees.")
        self.scene = Scene(motion)
        camera = self.scene.camera(azimuth, elevation, size[1] / height)
        self._pictures = OffscreenRenderer(self.scene.model, self.scene.data, (height, size[1]), camera)
        font = Path(matplotlib.get_data_path(), "fonts/ttf/DejaVuSans.ttf")
        self._font = ImageFont.truetype(str(font), TYPE_SIZE)

    def picture(self, frame: int) -> np.ndarray:
        """Return the picture of a frame, 0 to T, shape (height, width, 3), uint8."""
        self.scene.show(frame)
        whole = Image.new("RGB", (self.size[1], self.size[0]), PAPER)
        whole.paste(Image.fromarray(self._pictures.draw()), (0, self._strip))
        pen = ImageDraw.Draw(whole)
        heading = f"{self.title}, episode {self.motion.episode}, {self.motion.times[frame]:.2f} s"
        pen.text((EDGE, EDGE), heading, INK, self._font)
        for number, ghost in enumerate(self.motion.ghosts):
            top = EDGE + LINE * (1 + number)
            swatch = tuple(round(255 * part) for part in choose_colour(number)[:3])
            pen.rectangle((EDGE, top + 3, EDGE + 26, top + 15), swatch)
            error = f"   {ghost.error_text(frame, self.motion.units)}" if number else ""
            pen.text((EDGE + 36, top), ghost.name + error, INK, self._font)
        return np.asarray(whole)

    def close(self) -> None:
        """Free the renderer."""
        self._pictures.close()


def select_frames(motion: Motion, start: float, seconds: float | None, rate: float, speed: float) -> np.ndarray:
    """Return the frame of the episode for each picture of a film, shape (pictures,).

    Args:
        motion: Motion of the ghosts.
        start: Start of the film [s after the episode's start].
        seconds: Length of the shown part of the episode [s]; None for the rest.
        rate: Pictures per second [Hz].
        speed: Playback speed.

    Raises:
        OptionError: the episode ends before the film begins, or a number is not above 0.
    """
    for name, value in (("seconds", seconds), ("rate", rate), ("speed", speed)):
        if value is not None and not 0 < value < np.inf:
            raise OptionError(f"--{name} {value:g} must be a number above 0.")
    find_frame(motion, start, "--start")
    last = float(motion.times[-1])
    end = last if seconds is None else min(last, start + seconds)
    times = np.arange(start, end + 1e-9, speed / rate)
    return np.minimum(np.rint(times * motion.dataset.fps).astype(int), len(motion.times) - 1)


def find_frame(motion: Motion, seconds: float, option: str) -> int:
    """Return the frame at the time of an option [s after the episode's start].

    Raises:
        OptionError: the time is outside the episode.
    """
    last = float(motion.times[-1])
    if not 0 <= seconds <= last:
        raise OptionError(f"{option} {seconds:g} is outside episode {motion.episode}, which lasts {last:g} s.")
    return round(seconds * motion.dataset.fps)


def write_png(picture: np.ndarray, path: Path) -> None:
    """Write a picture, shape (height, width, 3), uint8."""
    content = BytesIO()
    Image.fromarray(picture).save(content, format="PNG", optimize=True)
    write_atomic(path, content.getvalue())


def write_mp4(
    film: Film,
    frames: Sequence[int] | np.ndarray,
    rate: float,
    path: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write a film as MP4 (H.264 if FFmpeg supports it), atomically.

    Args:
        film: The renderer.
        frames: Frame of each picture.
        rate: Pictures per second [Hz].
        path: Output file.
        progress: Called with the number of pictures done and in total.
    """
    import av

    av.logging.set_level(av.logging.ERROR)  # LeRobot enables messages of encoders
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with av.open(str(partial), "w", format="mp4", options={"movflags": "faststart"}) as container:
            codec = next(name for name in CODECS if name in av.codecs_available)
            stream = container.add_stream(codec, rate=round(rate), options=QUALITY.get(codec, {}))
            assert isinstance(stream, av.VideoStream)
            stream.height, stream.width = film.size
            stream.pix_fmt = "yuv420p"
            for done, frame in enumerate(frames, 1):
                picture = av.VideoFrame.from_ndarray(film.picture(int(frame)), format="rgb24")
                container.mux(stream.encode(picture))
                progress(done, len(frames))
            container.mux(stream.encode())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
