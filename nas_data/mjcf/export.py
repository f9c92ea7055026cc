"""A model file that plain MuJoCo loads wherever its folder is moved, with the files that it needs beside it."""

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TypeAlias
from xml.sax.saxutils import escape

import mujoco
import numpy as np

from nas_data.errors import ModelFileError
from nas_data.mjcf.strip_meshes import colliding_shapes, exact_xml, meshless, needs_files

ASSETS = "assets"
OTHER_MODELS = re.compile(r"<(?:model|include)\b[^>]*\bfile\s*=\s*[\"']([^\"']+)[\"']")
QUOTES = {"'": "&apos;", '"': "&quot;"}
CLOSE = 1e-4  # relative difference of what is read back: meshes lie in single precision

Asset: TypeAlias = mujoco.MjsMesh | mujoco.MjsHField | mujoco.MjsTexture | mujoco.MjsSkin


@dataclass(frozen=True)
class Reference:
    """A file that a model names.

    Attributes:
        asset: Element that names it.
        file: As it is named.
        side: Which side of a cube it is; None where it is the asset's only file.
    """

    asset: Asset
    file: str
    side: int | None = None

    def name(self, path: str) -> None:
        """Name another file in its place."""
        if self.side is None:
            self.asset.file = path
        else:
            self.asset.cubefiles[self.side] = path


def check_portable(spec: mujoco.MjSpec, original: Path) -> None:
    """Refuse a model that could not be written with effects in it, before they are sought.

    Raises:
        ModelFileError: says why.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_portable(spec.copy(), original, Path(folder) / "model.xml")


def write_portable(spec: mujoco.MjSpec, original: Path, path: Path) -> None:
    """Write a model as MJCF; files that it needs are copied to `assets` beside it.

    Files that cannot be found again (those of a model that another one attaches) are left out with the shapes in them
    where these touch nothing: masses are written out, so that it moves the same.

    Args:
        spec: Model with explicit inertias.
        original: File that it was read from.
        path: Where to.

    Raises:
        ModelFileError: MuJoCo cannot write it or read it again, or it needs files that cannot be found.
    """
    model = spec.compile()  # before any copy, which forgets what a sensor was last told to measure
    if not needs_files(spec):
        write(spec, original, path)
    elif not (copy_files(spec.copy(), original, path) and reads_back(path, model)):
        if colliding_shapes(spec):
            raise ModelFileError(
                f"{original} cannot be written as a model of its own: some file with a shape that can touch others is "
                "not where the model's own folders are; give a model that names all its files itself."
            )
        write(meshless(spec), original, path)
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise unwritable(original, error) from None


def write(spec: mujoco.MjSpec, original: Path, path: Path) -> None:
    """Write a model that needs no other files."""
    spec.meshdir = spec.texturedir = ""
    try:
        spec.compile()
        path.write_bytes(exact_xml(spec))
    except (ValueError, mujoco.FatalError) as error:
        raise unwritable(original, error) from None


def unwritable(original: Path, error: Exception) -> ModelFileError:
    """Return the error of a model that does not survive being written."""
    reason = " ".join(str(error).split()).rstrip(".")
    return ModelFileError(f"MuJoCo cannot read {original} again once it wrote it: {reason}; simplify the model.")


def copy_files(spec: mujoco.MjSpec, original: Path, path: Path) -> bool:
    """Write a model after copying the files that it names; return whether all of them were found."""
    found = [(reference, find_file(spec, reference, original)) for reference in references(spec)]
    if any(file is None for _, file in found):
        return False
    folder = path.resolve().parent / ASSETS
    folder.mkdir(exist_ok=True)
    # the engine reads them once more as it writes, so that until then they are named from the root
    spec.meshdir, spec.texturedir, spec.strippath = "", "", False
    for reference, file in found:
        assert file is not None
        reference.name(str(copy_beside(file, folder)))
    spec.compile()
    text = exact_xml(spec).decode().replace(f'="{escape(str(folder), QUOTES)}/', f'="{ASSETS}/')
    path.write_text(text, encoding="utf-8")
    return True


def references(spec: mujoco.MjSpec) -> Iterator[Reference]:
    """Yield all files that a model names."""
    for asset in (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures):
        if asset.file:
            yield Reference(asset, asset.file)
    for texture in spec.textures:
        yield from (Reference(texture, file, side) for side, file in enumerate(texture.cubefiles) if file)


def find_file(spec: mujoco.MjSpec, reference: Reference, original: Path) -> Path | None:
    """Return where a file is that a model names, or one that it attaches; None where that is not known."""
    compiler = reference.asset.compiler
    textures = isinstance(reference.asset, mujoco.MjsTexture)
    place = Path((compiler.texturedir if textures else compiler.meshdir) or "")
    own = [original.absolute().parent, original.resolve().parent]  # these differ where the model is a link
    folders = own if compiler is spec.compiler else [*model_folders(original), *own]
    named = (folder / place / file for folder in folders for file in (reference.file, Path(reference.file).name))
    return next((file for file in named if file.is_file()), None)


def model_folders(model: Path) -> list[Path]:
    """Return the folders of the files that a model file includes or attaches, and those that they do."""
    files = [model.resolve()]
    for file in files:  # which grow
        text = file.read_text(encoding="utf-8", errors="replace") if file.is_file() else ""
        others = [(file.parent / other).resolve() for other in OTHER_MODELS.findall(text)]
        files += [other for other in others if other not in files]
    return [file.parent for file in files[1:]]


def copy_beside(file: Path, folder: Path) -> Path:
    """Copy a file into a folder, beside another one of its name; return where it is then."""
    content = file.read_bytes()
    free = (folder / f"{file.stem}{number or ''}{file.suffix}" for number in count())
    target = next(path for path in free if not path.exists() or path.read_bytes() == content)
    if not target.exists():
        target.write_bytes(content)
    return target


def reads_back(path: Path, model: mujoco.MjModel) -> bool:
    """Whether a file gives the same masses and shapes as a compiled model."""
    try:
        read = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError):
        return False
    measures = [
        (each.body_mass, each.body_inertia, np.linalg.norm(each.mesh_vert, axis=1), each.hfield_data, each.tex_data)
        for each in (model, read)
    ]
    return all(
        one.shape == other.shape and np.allclose(one, other, rtol=CLOSE, atol=CLOSE * float(abs(one).max(initial=0)))
        for one, other in zip(*measures, strict=True)
    )
