"""Posed bodies of a take, in the camera's frame."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core_solver.body.kinematics import pose_joints, skin
from core_solver.take import Person

Array = NDArray[np.float64]


class PosablePerson:
    """One person of a take whose body can be had at any frame."""

    def __init__(self, person: Person) -> None:
        self.person = person

    @property
    def colour(self) -> tuple[int, int, int]:
        """Blue, green, red, 0-255."""
        red, green, blue = (round(255 * c) for c in self.person.colour)
        return blue, green, red

    @property
    def label(self) -> str:
        """Name and height, in the letters OpenCV can draw."""
        name = self.person.name if self.person.name.isascii() else f"Person {self.person.id}"
        return f"{name}  {self.person.height_m:.2f} m"

    @property
    def short_label(self) -> str:
        """Id and height."""
        return f"{self.person.id}: {self.person.height_m:.2f} m"

    def is_present(self, frame: int) -> bool:
        """Whether the frame lies between the first and the last sight of the person."""
        seen = np.flatnonzero(self.person.valid)
        return bool(seen.size and seen[0] <= frame <= seen[-1])

    @cached_property
    def _weights(self) -> Array:
        """(V, 24) from the take's four weights a vertex."""
        weights = np.zeros((len(self.person.weights), self.person.rest_joints.shape[0]))
        rows = np.arange(len(weights))[:, None]
        np.add.at(weights, (rows, self.person.weight_joints), self.person.weights)
        return weights

    def vertices(self, frame: int) -> Array:
        """(V, 3) metres."""
        person = self.person
        rotations, positions = pose_joints(person.theta[frame], person.rest_joints)
        posed = skin(person.rest_vertices, self._weights, rotations, positions, person.rest_joints)
        return person.scale * posed + person.gamma[frame]

    def joints(self) -> Array:
        """(T, 24, 3) metres, all frames."""
        person = self.person
        positions = pose_joints(person.theta, person.rest_joints)[1]
        return person.scale * positions + person.gamma[:, None]
