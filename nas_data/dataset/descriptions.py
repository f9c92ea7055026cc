"""LeRobot's descriptions of pass-through features: whether two of them are compatible, and their merged description."""

from collections.abc import Mapping, Sequence

Description = Mapping[str, object]

LANGUAGE = "language"
# Conversion of a depth camera's pixels to metres, in LeRobot's terms (DepthEncoderConfig of 0.6).
DEPTH_MARKS = ("is_depth_map", "video.is_depth_map")
DEPTH_SCALE = ("depth_unit", "video.depth_min", "video.depth_max", "video.shift", "video.use_log")
# Encoding of a video. Each file is self-describing, so files with different encodings can be merged.
ENCODER = (
    *("video.g", "video.crf", "video.preset", "video.fast_decode", "video.extra_options", "video.video_backend"),
    *("video.codec", "video.pix_fmt"),
)


def describe_kind(entry: Description) -> str:
    """Return type and shape in words."""
    depth = " (depth)" if is_depth(entry) else ""
    return f"{entry.get('dtype')} of shape {entry.get('shape')}{depth}"


def describe_left_out(features: Mapping[str, Description], reason: str) -> str:
    """Return a sentence without its full stop on features that are not passed through."""
    names = ", ".join(f"'{key}' ({describe_kind(entry)})" for key, entry in features.items())
    return f"left out: {names}, because {reason}"


def is_depth(entry: Description) -> bool:
    """Whether a camera measures depth, by LeRobot's own rule."""
    return any(_info(entry, key).get(mark) for key in ("info", "video_info") for mark in DEPTH_MARKS)


def find_difference(a: Description, b: Description) -> tuple[str, object, object] | None:
    """Return the entry in which the values of two features differ in meaning, with both values; None if none does."""
    for key in ("dtype", "shape"):
        if a.get(key) != b.get(key):
            return key, a.get(key), b.get(key)
    if is_depth(a) != is_depth(b):
        return DEPTH_MARKS[0], is_depth(a), is_depth(b)
    scales = [_info(entry, "info") if is_depth(entry) else {} for entry in (a, b)]
    unlike = next((key for key in DEPTH_SCALE if scales[0].get(key) != scales[1].get(key)), None)
    return None if unlike is None else (unlike, scales[0].get(unlike), scales[1].get(unlike))


def make_common_description(entries: Sequence[Description]) -> Description:
    """Return the description of merged features: the first one's, without differing encodings."""
    first, *others = entries
    if not others:
        return first
    infos = [_info(entry, "info") for entry in entries]
    unlike = [key for key in ENCODER if any(info.get(key) != infos[0].get(key) for info in infos)]
    # LeRobot's merge writes the same for unknown values.
    unknown: dict[str, object] = {key: {} if key == "video.extra_options" else None for key in unlike}
    return {**first, "info": {**infos[0], **unknown}} if unlike else first


def make_schema_entry(entry: Description) -> Mapping[str, object] | None:
    """Return the column type for `datasets`; None if it is inferred from the column itself.

    LeRobot's annotation and editing tools write columns without it.
    """
    if entry.get("dtype") == "image":
        return {"_type": "Image"}
    return {"dtype": "string", "_type": "Value"} if entry.get("dtype") == "string" else None


def _info(entry: Description, key: str) -> Mapping[str, object]:
    info = entry.get(key)
    return info if isinstance(info, Mapping) else {}
