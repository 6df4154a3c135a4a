"""All choices that are made before synthesis."""

from dataclasses import dataclass

from .protocol import MEAN_WINDOW_PIXELS, MOST_BEAMS, PRESET_NAMES, SENSOR_PIXELS, SMALL_SENSOR

__all__ = ["Config", "FRAMES_IN_FLIGHT", "FRAME_US", "PRESETS", "check_config"]

#: Time limit for a frame after its exposure, microseconds.
FRAME_US = 20_000
#: Frames whose points may still be on their way when the next one starts.
FRAMES_IN_FLIGHT = 4


@dataclass(frozen=True)
class Config:
    """Constructor choices of the whole design.

    Parameters
    ----------
    preset : :class:`str`
        One of :data:`hdl.protocol.PRESET_NAMES`: what measures the spots,
        :class:`hdl.capsule.Capsule` or :class:`hdl.paper.Paper`.
    clock_hz : :class:`int`
        System clock; whole megahertz, since one prescaler counts the microseconds.
    baud : :class:`int`
        Rate of the serial line out of reset, bits per second; the host may change it.
    width, height : :class:`int`
        Sensor size in pixels, 16 to 1024 each; 512 at most with the preset ``paper``.
    beams : :class:`int`
        Beams of the laser mesh (the paper's K), 1 to 512.
    lanes : :class:`int`
        Epipolar lines that are compared at a time (P), 1 to ``beams``.
    spot_depth : :class:`int`
        Spots that may wait for the stereo unit.
    mean_window : :class:`int`
        Side of the window of the local mean in pixels, odd, 5 to 31; the sensor must be at least
        twice as wide, and as high. Not used by the preset ``paper``.
    labels : :class:`int`
        Provisional labels of the two-pass labelling, best one less than a power of two; not used
        by the preset ``capsule``.
    converter_latency : :class:`int` or None
        None for an imager that sends frames by itself, with a clock of its own
        (:class:`hdl.acquisition.camera.Camera`). Otherwise its pixels are addressed, and this is
        the latency of an external converter in clocks, 1 to 64
        (:class:`hdl.acquisition.addressed_camera.AddressedCamera`).
    converter_interval : :class:`int`
        Clocks from one such pixel to the next, 2 to 64.

    Raises
    ------
    ValueError
        If a choice is out of its range.
    """

    preset: str = "capsule"
    clock_hz: int = 16_000_000
    baud: int = 115_200
    width: int = 352
    height: int = 288
    beams: int = 49
    lanes: int = 2
    spot_depth: int = 64
    mean_window: int = 11
    labels: int = 1023
    converter_latency: int | None = None
    converter_interval: int = 2

    def __post_init__(self):
        if self.preset not in PRESET_NAMES:
            raise ValueError(f"preset must be one of {', '.join(PRESET_NAMES)}, "
                             f"not {self.preset!r}")
        for name, low, high in [
            ("width", *SENSOR_PIXELS), ("height", *SENSOR_PIXELS), ("beams", 1, MOST_BEAMS),
            ("lanes", 1, self.beams),
            ("mean_window", *MEAN_WINDOW_PIXELS), ("spot_depth", 8, 512), ("labels", 1, 32767),
            ("clock_hz", 1_000_000, 65_000_000), ("baud", 1200, self.clock_hz // 2),
            ("converter_interval", 2, 64),
            *([] if self.converter_latency is None else [("converter_latency", 1, 64)]),
        ]:
            value = getattr(self, name)
            if not isinstance(value, int) or not low <= value <= high:
                raise ValueError(
                    f"{name} must be an integer from {low} to {high}, not {value!r}")
        if self.preset == "paper" and max(self.width, self.height) > SMALL_SENSOR:
            raise ValueError(
                f"The preset paper takes sensors of at most {SMALL_SENSOR} x {SMALL_SENSOR} pixels"
                f", not {self.width} x {self.height}: its words of the remap table and its "
                "external memory hold no more; use the preset capsule")
        if self.converter_latency is not None:
            read_us = self.width * self.height * self.converter_interval * 1e6 / self.clock_hz
            if read_us > FRAME_US - 1000:
                raise ValueError(
                    f"{self.width} x {self.height} pixels of {self.converter_interval} clocks each "
                    f"take {read_us:.0f} us to read, and a frame may take {FRAME_US - 1000} us: "
                    "make converter_interval less or clock_hz more")
        if self.mean_window % 2 == 0:
            raise ValueError(f"mean_window must be odd, not {self.mean_window}")
        if self.preset == "capsule" and (
                self.width < 2 * self.mean_window or self.height < self.mean_window):
            raise ValueError(
                f"A mean_window of {self.mean_window} needs a sensor of at least "
                f"{2 * self.mean_window} x {self.mean_window} pixels, not "
                f"{self.width} x {self.height}")
        if self.clock_hz % 1_000_000:
            raise ValueError(f"clock_hz must be a multiple of 1 MHz, not {self.clock_hz}")


def check_config(config):
    """Refuse anything but a :class:`Config`."""
    if not isinstance(config, Config):
        raise TypeError(f"The configuration must be a Config, not {config!r}")


PRESETS = {"capsule": Config(), "paper": Config(preset="paper", lanes=49)}
