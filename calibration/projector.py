"""The laser's mesh of beams as an ideal projector, seen by the camera."""

from dataclasses import dataclass, replace

import numpy as np

__all__ = ["Projector", "beam_slopes", "predict"]


@dataclass(frozen=True)
class Projector:
    """Laser and diffraction head: a mesh of straight beams from one point, seen by the camera.

    Beam = row * columns + column. Before rotation its direction is ((column - middle) tan(pitch),
    (row - middle) tan(pitch), 1); the mesh is turned by ``rotation_deg`` about its own axis (x
    towards y), by ``tilt_deg`` about x and by ``toe_in_deg`` about y, towards the camera's axis.

    Parameters
    ----------
    rows, columns : :class:`int`
        Size of the mesh.
    pitch_deg, rotation_deg, toe_in_deg, tilt_deg : :class:`float`
        Angles in degrees.
    base_mm : tuple of three :class:`float`
        The common origin of the beams, from the camera's pinhole, in millimetres.
    """

    rows: int
    columns: int
    pitch_deg: float
    rotation_deg: float
    toe_in_deg: float
    base_mm: tuple
    tilt_deg: float = 0.0

    @property
    def beams(self):
        """Number of beams."""
        return self.rows * self.columns

    def positions(self):
        """Row and column of every beam, from the middle of the mesh: two arrays (beams,)."""
        row, column = np.divmod(np.arange(self.beams), self.columns)
        return row - (self.rows - 1) / 2, column - (self.columns - 1) / 2

    def slopes(self):
        """dx/dz and dy/dz of every beam: array (beams, 2)."""
        return beam_slopes(*self.positions(), self.parameters())

    def parameters(self):
        """The seven numbers that a search may change, as a vector.

        Base in mm, tangent of the pitch, and rotation, toe-in and tilt in radians. The toe-in is
        signed: positive turns the mesh towards +x.
        """
        side = -1 if self.base_mm[0] > 0 else 1
        return np.array([*self.base_mm, np.tan(np.radians(self.pitch_deg)),
                         *np.radians([self.rotation_deg, side * self.toe_in_deg, self.tilt_deg])])

    def with_parameters(self, vector):
        """This projector with other :meth:`parameters`."""
        side = -1 if self.base_mm[0] > 0 else 1
        rotation, toe_in, tilt = np.degrees(vector[4:7])
        return replace(self, base_mm=tuple(float(value) for value in vector[:3]),
                       pitch_deg=float(np.degrees(np.arctan(vector[3]))),
                       rotation_deg=float(rotation), toe_in_deg=float(side * toe_in),
                       tilt_deg=float(tilt))


def beam_slopes(row, column, vector):
    """dx/dz and dy/dz of beams.

    Parameters
    ----------
    row, column : arrays (beams,) of :class:`float`
        Positions in the mesh, from its middle.
    vector : array (..., 7) of :class:`float`
        :meth:`Projector.parameters` of any number of projectors.

    Returns
    -------
    array (..., beams, 2)
    """
    pitch, rotation, toe_in, tilt = np.moveaxis(np.asarray(vector)[..., 3:7, None], -2, 0)
    x, y = column * pitch, row * pitch
    x, y = np.cos(rotation) * x - np.sin(rotation) * y, np.sin(rotation) * x + np.cos(rotation) * y
    y, z = y * np.cos(tilt) + np.sin(tilt), np.cos(tilt) - y * np.sin(tilt)
    x, z = x * np.cos(toe_in) + z * np.sin(toe_in), z * np.cos(toe_in) - x * np.sin(toe_in)
    return np.stack([x / z, y / z], axis=-1)


def predict(lens, row, column, vector, inverse_z):
    """Where the spots of beams appear, in undistorted pixels.

    Parameters
    ----------
    lens : :class:`calibration.lens.Lens`
        Focal length and principal point.
    row, column, vector
        As in :func:`beam_slopes`.
    inverse_z : :class:`float` or array (beams,)
        1/z in 1/mm of all spots, or of each.

    Returns
    -------
    array (..., beams, 2)
    """
    slope = beam_slopes(row, column, vector)
    vector = np.asarray(vector)
    base, back = vector[..., None, :2], vector[..., None, 2:3]
    normalised = slope + (base - back * slope) * np.atleast_1d(inverse_z)[:, None]
    return normalised * lens.focal + np.array([lens.principal_x, lens.principal_y])
