"""Complete rigs: camera, projector, spots, noise, and the distances they are made for.

======================= ============= ================ ============= ============= =============
rig                     ``endoscope`` ``demonstrator`` ``small``     ``dense``     ``vga``
======================= ============= ================ ============= ============= =============
sensor                  352 x 288     352 x 288        64 x 64       352 x 288     640 x 480
beams                   7 x 7         7 x 7            4 x 4         19 x 19       7 x 7
base                    5 mm          150 mm           5 mm          5 mm          5 mm
range                   40-110 mm     600-1100 mm      40-110 mm     40-110 mm     40-110 mm
smallest line distance  4.9 px        3.1 px           2.7 px        1.9 px        8.1 px
======================= ============= ================ ============= ============= =============

The smallest distance of two lines is that over the whole mesh, for ``dense`` that where spots of
both can be.
"""

from dataclasses import dataclass, replace

import numpy as np

from .geometry import Camera, Projector


@dataclass(frozen=True)
class Spots:
    """The spots of beams on tissue.

    A beam is Gaussian; its standard deviation grows from `waist_mm` by `divergence_mrad` with the
    distance from the projector. The lens adds a blur of `blur_px`. The light that reaches the lens
    is Lambert's, with a cosine of at least `least_cosine`, over the square of the distance. The
    exposure is set on each frame so that nine spots in ten peak at `peak` levels or less, within a
    factor of `exposure_span` up or down of the one for the middle of the range.

    With `split`, every beam is divided into rays, so that curved surfaces bend spots and edges
    divide them; without, each is an ellipse on the plane tangent to the surface at its axis.
    """

    waist_mm: float
    divergence_mrad: float
    blur_px: float
    peak: float = 190.0
    least_cosine: float = 0.3
    exposure_span: float = 4.0
    split: bool = False


@dataclass(frozen=True)
class Noise:
    """What the sensor adds: `read` levels rms, and shot noise of `electrons` per level.

    The background has `background` levels in the middle of the image, less towards the corners by
    `vignetting` (a part of it, reached in the corner), and a smooth texture of `texture` (rms, a
    part of it).
    """

    read: float = 2.0
    electrons: float = 40.0
    background: float = 12.0
    vignetting: float = 0.35
    texture: float = 0.08


@dataclass(frozen=True)
class Board:
    """Chessboard for the lens: inner corners and the side of a square."""

    columns: int
    rows: int
    square_mm: float


@dataclass(frozen=True)
class Rig:
    """All properties of a simulated rig."""

    name: str
    camera: Camera
    projector: Projector
    spots: Spots
    noise: Noise
    board: Board
    range_mm: tuple[float, float]
    margin_px: float = 6.0

    @property
    def middle_mm(self) -> float:
        """The distance in the middle of the range, in 1 / z."""
        return 2 / (1 / self.range_mm[0] + 1 / self.range_mm[1])

    @property
    def scale(self) -> float:
        """Size of this rig's scenes relative to the endoscope's (range 40 to 110 mm)."""
        return self.middle_mm / (2 / (1 / 40 + 1 / 110))

    @property
    def reach(self) -> float:
        """The largest tangent between the optical axis and a spot."""
        points = np.concatenate([self.projector.points_at(z) for z in self.range_mm])
        return float((np.hypot(points[:, 0], points[:, 1]) / points[:, 2]).max())

    def with_filters(self, bayer: str | None) -> "Rig":
        """The same rig, its sensor with colour filters, one of :data:`model.bayer.BAYER`."""
        return replace(self, camera=replace(self.camera, bayer=bayer))

    def calibration_planes(self, count: int = 12) -> np.ndarray:
        """Distances of the flat target, even in 1 / z, a little beyond the range at both ends."""
        low, high = self.range_mm
        return np.round(1 / np.linspace(1 / (low * 0.96), 1 / (high * 1.04), count), 2)


@dataclass(frozen=True)
class Nominal:
    """Nominal values, as in the maker's drawing: those of ``capture.toml``."""

    focal_px: float
    pitch_deg: float
    rotation_deg: float
    toe_in_deg: float
    base_mm: tuple[float, float, float]


def nominal(rig: Rig, rng: np.random.Generator, error: float = 1.0) -> Nominal:
    """Nominal values that differ from the true ones, the rig's, by the default error.

    Focal length, pitch and base are off by up to 3 %, rotation and toe-in by up to 1 degree, the
    base's direction by up to half a degree; `error` scales all of it, 0 giving the truth.
    """
    focal, pitch, base = 1 + 0.03 * error * rng.uniform(-1, 1, 3)
    rotation, toe_in = error * rng.uniform(-1, 1, 2)
    aside = np.radians(0.5) * error * rng.uniform(-1, 1, 2)
    projector = rig.projector
    true_base = np.asarray(projector.base_mm)
    length = np.linalg.norm(true_base)
    wrong_base = true_base * base + np.array([0, *(aside * length)])
    return Nominal(
        focal_px=round(rig.camera.focal_px * focal, 2),
        pitch_deg=round(projector.pitch_deg * pitch, 4),
        rotation_deg=round(projector.rotation_deg + rotation, 3),
        toe_in_deg=round(projector.toe_in_deg + toe_in, 3),
        base_mm=tuple(round(float(part), 4) for part in wrong_base),
    )


_ENDOSCOPE = Rig(
    name="endoscope",
    camera=Camera(352, 288, 360.0, (177.1, 142.3), k1=-0.12, k2=0.02, p1=5e-4, p2=-4e-4),
    projector=Projector(7, 7, 6.3, 8.5, 2.5, (5.0, 0.05, 0.12), irregularity_deg=0.02),
    spots=Spots(waist_mm=0.10, divergence_mrad=3.0, blur_px=0.8),
    noise=Noise(),
    board=Board(9, 6, 4.0),
    range_mm=(40.0, 110.0),
)

_DEMONSTRATOR = Rig(
    name="demonstrator",
    camera=Camera(352, 288, 500.0, (174.2, 144.9), k1=-0.10, k2=0.015, p1=-4e-4, p2=5e-4),
    projector=Projector(7, 7, 3.7, 7.75, 8.0, (150.0, 1.0, 2.0), irregularity_deg=0.01),
    spots=Spots(waist_mm=0.8, divergence_mrad=2.4, blur_px=0.8),
    noise=Noise(),
    board=Board(9, 6, 40.0),
    range_mm=(600.0, 1100.0),
)

_SMALL = replace(
    _ENDOSCOPE,
    name="small",
    camera=Camera(64, 64, 80.0, (31.9, 31.2), k1=-0.12, k2=0.02, p1=5e-4, p2=-4e-4),
    projector=Projector(4, 4, 9.0, 14.25, 4.0, (5.0, 0.05, 0.12), irregularity_deg=0.05),
    spots=Spots(waist_mm=0.20, divergence_mrad=12.0, blur_px=0.8),
    board=Board(5, 4, 8.0),
    margin_px=3.0,
)

_DENSE = replace(
    _ENDOSCOPE,
    name="dense",
    projector=Projector(19, 19, 2.1, 11.5, 2.5, (5.0, 0.05, 0.12), irregularity_deg=0.02),
    margin_px=4.0,
)

_VGA = replace(
    _ENDOSCOPE,
    name="vga",
    camera=Camera(640, 480, 600.0, (322.3, 237.1), k1=-0.12, k2=0.02, p1=5e-4, p2=-4e-4),
)

#: Ready rigs by name.
RIGS = {rig.name: rig for rig in (_ENDOSCOPE, _DEMONSTRATOR, _SMALL, _DENSE, _VGA)}
