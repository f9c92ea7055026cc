"""Export of a model as an MJCF file with its assets in the same folder, so that the folder can be moved."""

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
from nas_data.mjcf.strip_meshes import count_colliding_geoms, format_exact_xml, needs_files, strip_meshes

ASSETS = "assets"
OTHER_MODELS = re.compile(r"<(?:model|include)\b[^>]*\bfile\s*=\s*[\"']([^\"']+)[\"']")
QUOTES = {"'": "&apos;", '"': "&quot;"}
READBACK_TOLERANCE = 1e-4  # relative tolerance of the model read back: meshes have single precision

Asset: TypeAlias = mujoco.MjsMesh | mujoco.MjsHField | mujoco.MjsTexture | mujoco.MjsSkin


@dataclass(frozen=True)
class Reference:
    """A model's reference to a file.

    Attributes:
        asset: Element with the reference.
        file: Path as written in the model.
        side: Side of a cube texture; None if it is the asset's only file.
    """

    asset: Asset
    file: str
    side: int | None = None

    def redirect(self, path: str) -> None:
        """Refer to another file."""
        if self.side is None:
            self.asset.file = path
        else:
            self.asset.cubefiles[self.side] = path


def check_portable(spec: mujoco.MjSpec, original: Path) -> None:
    """Check that a model can be exported.

    Raises:
        ModelFileError: it cannot; the message says why.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_portable(spec.copy(), original, Path(folder) / "model.xml")


def write_portable(spec: mujoco.MjSpec, original: Path, path: Path) -> None:
    """Write a model as MJCF, and copy its assets to `assets` in the same folder.

    Assets of attached models may not be found. If so, all meshes are left out, provided that they do not collide.
    Inertias are explicit, so that the dynamics stay the same.

    Args:
        spec: Model with explicit inertias.
        original: File from which it was read.
        path: File to write.

    Raises:
        ModelFileError: MuJoCo cannot write the model or read it back, or colliding assets are not found.
    """
    model = spec.compile()  # first: a copy of the spec loses changes of a sensor's object
    if not needs_files(spec):
        write(spec, original, path)
    elif not (copy_files(spec.copy(), original, path) and is_same_model(path, model)):
        if count_colliding_geoms(spec):
            raise ModelFileError(
                f"{original} cannot be written as a model of its own: the file of a colliding shape is outside the "
                "model's mesh folders; give a model that names the path of each of its files."
            )
        write(strip_meshes(spec), original, path)
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise export_error(original, error) from None


def write(spec: mujoco.MjSpec, original: Path, path: Path) -> None:
    """Write a model without assets."""
    spec.meshdir = spec.texturedir = ""
    try:
        spec.compile()
        path.write_bytes(format_exact_xml(spec))
    except (ValueError, mujoco.FatalError) as error:
        raise export_error(original, error) from None


def export_error(original: Path, error: Exception) -> ModelFileError:
    """Return the error for a model that MuJoCo cannot write or read back."""
    reason = " ".join(str(error).split()).rstrip(".")
    return ModelFileError(f"MuJoCo cannot read {original} after saving it: {reason}; simplify the model.")


def copy_files(spec: mujoco.MjSpec, original: Path, path: Path) -> bool:
    """Write a model and copy its assets; return False, and write nothing, if an asset is not found."""
    found = [(reference, find_file(spec, reference, original)) for reference in find_references(spec)]
    if any(file is None for _, file in found):
        return False
    folder = path.resolve().parent / ASSETS
    folder.mkdir(exist_ok=True)
    # MuJoCo reads the assets again when it writes the model, so that their paths must be absolute until then
    spec.meshdir, spec.texturedir, spec.strippath = "", "", False
    for reference, file in found:
        assert file is not None
        reference.redirect(str(copy_asset(file, folder)))
    spec.compile()
    text = format_exact_xml(spec).decode().replace(f'="{escape(str(folder), QUOTES)}/', f'="{ASSETS}/')
    path.write_text(text, encoding="utf-8")
    return True


def find_references(spec: mujoco.MjSpec) -> Iterator[Reference]:
    """Yield all references of a model to files."""
    for asset in (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures):
        if asset.file:
            yield Reference(asset, asset.file)
    for texture in spec.textures:
        yield from (Reference(texture, file, side) for side, file in enumerate(texture.cubefiles) if file)


def find_file(spec: mujoco.MjSpec, reference: Reference, original: Path) -> Path | None:
    """Return the path of a referenced file of a model, or of a model that it attaches; None if it is not found."""
    compiler = reference.asset.compiler
    textures = isinstance(reference.asset, mujoco.MjsTexture)
    subfolder = Path((compiler.texturedir if textures else compiler.meshdir) or "")
    own = [original.absolute().parent, original.resolve().parent]  # these differ if the model is a symbolic link
    folders = own if compiler is spec.compiler else [*model_folders(original), *own]
    named = (folder / subfolder / file for folder in folders for file in (reference.file, Path(reference.file).name))
    return next((file for file in named if file.is_file()), None)


def model_folders(model: Path) -> list[Path]:
    """Return the folders of the files that a model file includes or attaches, directly or indirectly."""
    files = [model.resolve()]
    for file in files:  # the list grows in the loop
        text = file.read_text(encoding="utf-8", errors="replace") if file.is_file() else ""
        others = [(file.parent / other).resolve() for other in OTHER_MODELS.findall(text)]
        files += [other for other in others if other not in files]
    return [file.parent for file in files[1:]]


def copy_asset(file: Path, folder: Path) -> Path:
    """Copy a file into a folder, with a number in its name if another file has that name; return its new path."""
    content = file.read_bytes()
    free = (folder / f"{file.stem}{number or ''}{file.suffix}" for number in count())
    target = next(path for path in free if not path.exists() or path.read_bytes() == content)
    if not target.exists():
        target.write_bytes(content)
    return target


def is_same_model(path: Path, model: mujoco.MjModel) -> bool:
    """Whether a model file has the same masses and assets as a compiled model."""
    try:
        read = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError):
        return False
    measures = [
        (each.body_mass, each.body_inertia, np.linalg.norm(each.mesh_vert, axis=1), each.hfield_data, each.tex_data)
        for each in (model, read)
    ]
    return all(
        one.shape == other.shape
        and np.allclose(one, other, rtol=READBACK_TOLERANCE, atol=READBACK_TOLERANCE * float(abs(one).max(initial=0)))
        for one, other in zip(*measures, strict=True)
    )
