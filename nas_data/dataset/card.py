"""The dataset card: `README.md` with the front matter that the Hugging Face Hub and LeRobot expect."""

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import SIM_STATE
from nas_data.dataset.provenance import Provenance

FRONT_MATTER = """---
task_categories:
- robotics
tags:
- LeRobot
- {robot}
configs:
- config_name: default
  data_files: data/*/*.parquet
---
"""

BODY = """
# {robot}: {episodes}, {frames} at {rate} Hz

This dataset is in [LeRobot](https://github.com/huggingface/lerobot) v3.0 format and was written by nas_data.

- recorded: {how}, {when}
- paired with a source simulator: {paired}
- content hash: `{content_hash}`
- provenance: [meta/nas.json](meta/nas.json)

| feature | dtype | components | unit |
| --- | --- | --- | --- |
{table}

```python
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("local/name", root="this/folder")
```
"""


def render_card(dataset: Dataset, provenance: Provenance) -> str:
    """Return the text of a dataset's card."""
    rows = [
        f"| `{key}` | {feature.dtype} | {', '.join(feature.names)} | {', '.join(dict.fromkeys(feature.units)) or '–'} |"
        for key, feature in dataset.features.items()
    ]
    robot = dataset.robot_type.replace("\n", " ")
    body = BODY.format(
        robot=robot,
        episodes=count_of(dataset.n_episodes, "episode"),
        frames=count_of(dataset.n_frames, "frame"),
        rate=f"{dataset.fps:g}",
        how=provenance.how,
        when=provenance.when,
        paired=f"yes, `{SIM_STATE}`" if dataset.paired else "no",
        content_hash=provenance.content_hash,
        table="\n".join(rows),
    )
    return FRONT_MATTER.format(robot=_quote_yaml(robot)) + body


def _quote_yaml(text: str) -> str:
    """Return a text as a YAML scalar; JSON quoting is valid YAML."""
    return text if text.replace("_", "").replace("-", "").isalnum() else '"' + text.replace('"', "'") + '"'
