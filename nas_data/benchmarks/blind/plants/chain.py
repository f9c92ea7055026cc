"""Batched rigid-body dynamics of serial chains: composite inertias for M(q), Newton-Euler for the bias."""

from functools import cached_property

import numpy as np

from nas_data.benchmarks.blind.plants.constants import Links
from nas_data.benchmarks.blind.plants.vectors import cross, from_here_on, skew


class Chain(Links):
    """B simulations of a serial chain; every array has a leading axis of size B."""

    @cached_property
    def _slides(self) -> bool:
        """Whether any joint slides; if none does, its terms are skipped to save time."""
        return bool(self.sliding.any())

    @cached_property
    def _rodrigues(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients of sin q and 1 − cos q in each link's rotation (Rodrigues' formula)."""
        turning = skew(self.axes)
        return self.turns @ turning, self.turns @ turning @ turning

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the links' rotations (B, n, 3, 3) and the joints' positions (B, n, 3) in the base frame."""
        sine, cosine = np.sin(q)[..., None, None], np.cos(q)[..., None, None]
        by_sine, by_cosine = self._rodrigues
        local = self.turns + sine * by_sine + (1 - cosine) * by_cosine
        offsets = self.offsets
        if self._slides:
            local = np.where(self.sliding[..., None, None], self.turns, local)
            along = (self.turns @ self.axes[..., None])[..., 0]
            offsets = offsets + along * np.where(self.sliding, q, 0)[..., None]
        rotations, places = np.empty_like(local), np.empty(local.shape[:-1])
        rotations[:, 0], places[:, 0] = local[:, 0], offsets[:, 0]
        for link in range(1, places.shape[1]):
            np.matmul(rotations[:, link - 1], local[:, link], out=rotations[:, link])
            places[:, link] = places[:, link - 1] + (rotations[:, link - 1] @ offsets[:, link, :, None])[..., 0]
        return rotations, places

    def dynamics(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return M(q) and bias torques for angles [rad] and speeds [rad/s], (B, n) each: M · dv/dt + bias = torque.

        Returns:
            Mass matrices [kg m²], shape (B, n, n), and bias torques [N m], shape (B, n).
        """
        rotations, places = self.frames(q)
        axes = (rotations @ self.axes[..., None])[..., 0]
        shifting = np.zeros_like(axes)  # velocity of everything beyond a joint that slides at unit speed
        if self._slides:
            along = self.sliding[..., None]
            axes, shifting = np.where(along, 0.0, axes), np.where(along, axes, 0.0)
        lever = (rotations @ self.centres[..., None])[..., 0]
        inertias = rotations @ self.inertias @ rotations.swapaxes(-1, -2)
        # up to sign, velocity at the base's origin of a body that moves rigidly with the joint at unit speed
        moments = cross(axes, places) - shifting
        mass = self._compute_mass_matrix(axes, places, places + lever, inertias, moments)
        return mass, self._compute_bias(axes, places, lever, inertias, moments, v, shifting)

    def _compute_mass_matrix(
        self, axes: np.ndarray, places: np.ndarray, centres: np.ndarray, inertias: np.ndarray, moments: np.ndarray
    ) -> np.ndarray:
        """Composite-rigid-body method (Featherstone 2008) with moments about the base's origin."""
        weighted = self.masses[..., None] * centres
        square = (weighted * centres).sum(-1)[..., None, None] * np.eye(3)
        about_origin = from_here_on(inertias + square - weighted[..., :, None] * centres[..., None, :])
        first, total = from_here_on(weighted), from_here_on(self.masses)[..., None]
        # momentum of link l and everything beyond when joint l alone turns at 1 rad/s
        linear = cross(axes, first) - total * moments
        angular = (about_origin @ axes[..., None])[..., 0] - cross(first, moments)
        full = axes @ angular.swapaxes(-1, -2) - moments @ linear.swapaxes(-1, -2)
        upper = np.triu(full)
        return np.asarray(upper + np.triu(full, 1).swapaxes(-1, -2))

    def _compute_bias(
        self,
        axes: np.ndarray,
        places: np.ndarray,
        lever: np.ndarray,
        inertias: np.ndarray,
        moments: np.ndarray,
        v: np.ndarray,
        shifting: np.ndarray,
    ) -> np.ndarray:
        """Newton-Euler with zero joint accelerations; the outward recursion is a cumulative sum."""
        turning = axes * v[..., None]
        spin = turning.cumsum(axis=1)
        twist = cross(spin - turning, turning).cumsum(axis=1)  # angular acceleration
        step = np.diff(places, axis=1)
        before_spin, before_twist = spin[:, :-1], twist[:, :-1]
        joints = np.zeros_like(places)
        joints[:, 1:] = cross(before_twist, step) + cross(before_spin, cross(before_spin, step))
        if self._slides:  # Coriolis acceleration of a slide on a rotating link
            joints[:, 1:] += 2 * cross(before_spin, shifting[:, 1:] * v[:, 1:, None])
        joints[:, 1:] = joints[:, 1:].cumsum(axis=1)
        acceleration = joints + cross(twist, lever) + cross(spin, cross(spin, lever)) - self.gravity[:, None]
        forces = self.masses[..., None] * acceleration
        carried = (inertias @ spin[..., None])[..., 0]
        torques = (inertias @ twist[..., None])[..., 0] + cross(spin, carried) + cross(places + lever, forces)
        return np.asarray((axes * from_here_on(torques) - moments * from_here_on(forces)).sum(-1))
