"""Pusher's forward baseline as the authors had it: ψ predicts what the policy sees, the puck and the gripper as well.

    python docs/results/authors_forward.py runs/authors_forward 300 0 1

In our `forward` ψ moves the arm, and the physics moves the puck, which the policy sees where it is. In the authors' ψ
gives the policy its whole observation; the physics, set to the arm that ψ predicts, moves a puck that only the reward
knows. Network, training and recording are theirs: ten changes (angles, speeds, gripper, puck) from observation and
action, 3 × 128, single steps along 250 trajectories with a new action every step. The number is the density of the
three links: 300 as in their model file, 1000 as in later code of theirs. ψ is judged on trajectories, policies on
starts, that they have not seen; both targets are those of `--dynamics paper`.
"""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import torch
import tyro
from torch import nn

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ENVIRONMENT, NEXT_ENVIRONMENT
from nas_data.envs import pusher
from nas_data.envs.base import Task, find_task
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.pusher import GRIPPER, Pusher, compute_puck_positions
from nas_data.policies.evaluate import score_policy, summarise_spread
from nas_data.policies.policy import load_policy
from nas_data.policies.ppo import PolicyTraining, train
from nas_data.recorders.recipe import Recipe
from nas_data.robots.base import ConsecutiveEdits
from nas_data.runs.environment_info import find_commit, read_versions
from nas_data.simulators.base import Stepper

SEEN = 10  # three angles [rad], three speeds [rad/s], x and y [m] of gripper and puck
PUCK = slice(8, 10)
MOVED = 0.01  # [m] a puck that went farther was touched
RECORDED, HELDOUT = 250, 100  # trajectories, the paper's number and ours
STEPS, BATCH, UPDATES = 100, 16, 6250
LINKS = ("link1", "link2", "link3")


class Psi(nn.Module):
    """The authors' network for Pusher: linear, leaky ReLU, LSTM, leaky ReLU, linear."""

    def __init__(self) -> None:
        super().__init__()
        self.enter, self.leave = nn.Linear(SEEN + 3, 128), nn.Linear(128, SEEN)
        self.lstm = nn.LSTM(128, 128, 3, batch_first=True)
        for name, width in (("input", SEEN + 3), ("output", SEEN)):
            self.register_buffer(f"{name}_mean", torch.zeros(width))
            self.register_buffer(f"{name}_sd", torch.ones(width))

    def forward(self, inputs: torch.Tensor, memory: object = None) -> tuple[torch.Tensor, object]:
        """Return normalised changes (B, T, 10) after observations and actions (B, T, 13), and the memory."""
        x = nn.functional.leaky_relu(self.enter((inputs - self.input_mean) / self.input_sd))
        x, memory = self.lstm(x, memory)
        return self.leave(nn.functional.leaky_relu(x)), memory

    def changes(self, seen: np.ndarray, commands: np.ndarray, memory: object) -> tuple[np.ndarray, object]:
        """Return the changes (B, 10) of one step, and the memory."""
        with torch.no_grad():
            inputs = torch.from_numpy(np.concatenate([seen, commands], axis=1).astype(np.float32))[:, None]
            out, memory = self(inputs, memory)
            return (out[:, 0] * self.output_sd + self.output_mean).numpy().astype(float), memory


def observed(dataset: Dataset, source: Stepper) -> tuple[np.ndarray, np.ndarray]:
    """Return what a policy would have seen before and after each step, shapes (E, T, 10)."""
    shape = (dataset.n_episodes, -1, SEEN)
    ends = []
    for states, objects in (
        (dataset.states, dataset.columns[ENVIRONMENT]),
        (dataset.next_states, dataset.columns[NEXT_ENVIRONMENT]),
    ):
        states = np.asarray(states, float)
        gripper = np.concatenate(
            [placed(source, states[at : at + source.size]) for at in range(0, len(states), source.size)]
        )
        ends.append(np.concatenate([states, gripper, np.asarray(objects, float)[:, 1::-1]], axis=1).reshape(shape))
    return ends[0], ends[1]


def placed(source: Stepper, states: np.ndarray) -> np.ndarray:
    """Return where the gripper is [m] in joint states (B, 6), shape (B, 2)."""
    padded = np.concatenate([states, np.zeros((source.size - len(states), states.shape[1]))])
    source.reset(padded)
    return source.site_positions(GRIPPER)[: len(states), :2]


def learn(before: np.ndarray, after: np.ndarray, actions: np.ndarray) -> Psi:
    """Train ψ as the authors did: mean squared error of single steps, Adam, the rate halved thrice."""
    torch.manual_seed(0)
    rng, psi = np.random.default_rng(0), Psi()
    inputs = torch.from_numpy(np.concatenate([before, actions], axis=2).astype(np.float32))
    targets = torch.from_numpy((after - before).astype(np.float32))
    for name, values in (("input", inputs), ("output", targets)):
        getattr(psi, f"{name}_mean").copy_(values.mean((0, 1)))
        getattr(psi, f"{name}_sd").copy_(values.std((0, 1)))
    targets = (targets - psi.output_mean) / psi.output_sd
    epochs = UPDATES * BATCH // len(inputs)
    adam = torch.optim.Adam(psi.parameters(), lr=1e-3)
    rate = torch.optim.lr_scheduler.MultiStepLR(adam, [int(epochs * share) for share in (0.4, 0.7, 0.8)], 0.5)
    for epoch in range(epochs):
        losses = []
        for rows in np.array_split(rng.permutation(len(inputs)), len(inputs) // BATCH):
            loss = nn.functional.mse_loss(psi(inputs[rows])[0], targets[rows])
            adam.zero_grad()
            loss.backward()
            adam.step()
            losses.append(loss.item())
        rate.step()
        print(f"epoch {epoch + 1} of {epochs}: loss {np.mean(losses):.4f}", file=sys.stderr)
    return psi


def open_loop(psi: Psi, before: np.ndarray, after: np.ndarray, actions: np.ndarray) -> dict[str, float]:
    """Return how far off [m] the puck is after an episode in open loop, and what holding its place is worth."""
    seen, memory = before[:, 0].copy(), None
    for step in range(actions.shape[1]):
        change, memory = psi.changes(seen, actions[:, step], memory)
        seen = seen + change
    moved = np.linalg.norm(after[:, -1, PUCK] - before[:, 0, PUCK], axis=1)
    missed = np.linalg.norm(after[:, -1, PUCK] - seen[:, PUCK], axis=1)
    touched = moved > MOVED
    return {
        "episodes": len(moved),
        "touched": int(touched.sum()),
        "puck_error_touched": float(missed[touched].mean()),
        "puck_error_touched_hold": float(moved[touched].mean()),
        "puck_error_untouched": float(missed[~touched].mean()),
        "puck_error_untouched_hold": float(moved[~touched].mean()),
    }


class AuthorsForward:
    """Simulations whose arm ψ moves, and what ψ says that a policy sees; implements `Stepper`."""

    def __init__(self, source: Stepper, psi: Psi) -> None:
        self.source, self.psi = source, psi
        self.joints, self.size = source.joints, source.size
        self.seen = np.zeros((source.size, SEEN))
        self._memory = (torch.zeros(3, source.size, 128), torch.zeros(3, source.size, 128))

    @property
    def states(self) -> np.ndarray:
        """Angles [rad] and speeds [rad/s] that ψ predicted, shape (B, 6)."""
        return self.source.states

    @property
    def objects(self) -> np.ndarray:
        """Where the physics has the pucks; see `Stepper.objects`."""
        return self.source.objects

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; there are none."""
        self.source.command_objects(targets, rows)

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Start simulations anew, ψ's memory zeroed; see `Stepper.reset`."""
        self.source.reset(states, rows)
        chosen = slice(None) if rows is None else rows
        for part in self._memory:
            part[:, chosen] = 0.0
        whole = [
            self.source.states,
            self.source.site_positions(GRIPPER)[:, :2],
            compute_puck_positions(self.source)[:, :2],
        ]
        self.seen[chosen] = np.concatenate(whole, axis=1)[chosen]

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Step the physics for the puck's sake, then ψ, and set the arm to what ψ says; see `Stepper.step`."""
        self.source.step(commands)
        change, memory = self.psi.changes(self.seen, commands, self._memory)
        self._memory = tuple(part.clone() for part in memory)
        self.seen = np.clip(self.seen + change, -20.0, 20.0)
        self.source.set_states(self.seen[:, :6])
        return self.source.states

    def set_states(self, states: np.ndarray) -> None:
        """Set the joints' state (B, 6)."""
        self.source.set_states(states)

    def site_positions(self, name: str) -> np.ndarray:
        """Return where a site is [m], shape (B, 3)."""
        return self.source.site_positions(name)


class Predicted(Pusher):
    """Pusher, observed through ψ."""

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return what ψ says and the goals, shape (B, 12)."""
        seen = np.concatenate([stepper.seen, goals], axis=1).astype(np.float32)
        return np.clip(seen, self.observation_space.low, self.observation_space.high)


@dataclass(frozen=True)
class AuthorsPlant(DynamicsSpec):
    """The plain physics with that task, beside the simulations that are handed to the training."""

    @property
    def task(self) -> Task:
        """The task, observed through ψ."""
        return Predicted(**vars(find_task(self.environment)))


def weigh(density: float) -> None:
    """Give the links of the source and of the authors' target a density [kg/m³]."""

    def edit(spec: mujoco.MjSpec) -> None:
        for name in LINKS:
            spec.geom(name).density = density

    edits = dict(pusher.TASK.edits)
    edits |= {name: ConsecutiveEdits(edits.get(name), edit) for name in ("source", "paper")}
    pusher.TASK = replace(pusher.TASK, edits=edits)


def main(
    out: tyro.conf.Positional[Path],
    density: tyro.conf.Positional[float],
    seeds: tyro.conf.Positional[tuple[int, ...]] = (0,),
) -> None:
    """Record, learn ψ and policies, judge both, and write what came out.

    Args:
        out: Folder of ψ, the policies and result.json; goes on where it stopped.
        density: Density of the links [kg/m³]: 300 as in the authors' model file, 1000 as in later code of theirs.
        seeds: Seeds of the policies.
    """
    weigh(density)
    source = find_task("Pusher").simulator("source")
    seen, actions = {}, {}
    for name, count, seed in (("train", RECORDED, 0), ("heldout", HELDOUT, 1)):
        data, _ = Recipe(
            environment="pusher", dynamics="paper", episodes=count, steps=STEPS, holds=(1,), seed=seed
        ).record()
        seen[name] = observed(data, source.stepper(STEPS))
        actions[name] = np.asarray(data.commands, float).reshape(count, STEPS, 3)
    kept, psi = out / "psi.pt", Psi()
    if kept.is_file():
        psi.load_state_dict(torch.load(kept, weights_only=True))
    else:
        psi = learn(*seen["train"], actions["train"])
        out.mkdir(parents=True, exist_ok=True)
        torch.save(psi.state_dict(), kept)
    found: dict[str, object] = {"density": density, "psi": open_loop(psi, *seen["heldout"], actions["heldout"])}
    plant, policies = AuthorsPlant("Pusher"), []
    for seed in seeds:
        folder = train(
            PolicyTraining(plant, seed), out / f"seed{seed}", stepper=AuthorsForward(source.stepper(16), psi)
        )
        policy = load_policy(folder)
        own = score_policy(policy, plant, 100, AuthorsForward(source.stepper(100), psi))
        on_target = score_policy(policy, DynamicsSpec("Pusher", "paper"), 100)
        policies.append({"seed": seed, "target": on_target.describe(), "own_world": own.describe()})
        print(f"seed {seed}: {on_target.mean_return:.2f} on the target, {own.mean_return:.2f} in its own world")
    found |= {
        "policies": policies,
        "return": summarise_spread(np.array([each["target"]["return"] for each in policies])),
    }
    found |= {"trajectories": RECORDED, "updates": UPDATES, "commit": find_commit(), "versions": read_versions()}
    (out / "result.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps({"psi": found["psi"], "return": found["return"]}, indent=1))


if __name__ == "__main__":
    tyro.cli(main)
