"""Everything that is chosen before synthesis, in one place."""

from dataclasses import dataclass

__all__ = ["Config", "PRESETS"]


@dataclass(frozen=True)
class Config:
    """Constructor choices of the whole design.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor size in pixels, 16 to 512 each.
    beams : :class:`int`
        Beams of the laser mesh (the paper's K), 1 to 128.
    lanes : :class:`int`
        Epipolar lines that are tried at a time (P), 1 to ``beams``.
    spot_depth : :class:`int`
        Spots that may wait for the stereo unit.

    Raises
    ------
    ValueError
        If a choice is out of its range.
    """

    width: int = 352
    height: int = 288
    beams: int = 49
    lanes: int = 2
    spot_depth: int = 64

    def __post_init__(self):
        for name, low, high in [
            ("width", 16, 512), ("height", 16, 512), ("beams", 1, 128), ("lanes", 1, self.beams),
            ("spot_depth", 8, 512),
        ]:
            value = getattr(self, name)
            if not isinstance(value, int) or not low <= value <= high:
                raise ValueError(
                    f"{name} must be an integer from {low} to {high}, not {value!r}")


PRESETS = {"capsule": Config()}
