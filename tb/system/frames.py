"""Whole frames through the capsule in cocotb, and what is measured there."""

import pickle
import tempfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from amaranth.hdl import Shape

from hdl.capsule import Capsule
from hdl.config import PRESETS
from hdl.export import to_fast_verilog
from tb import hdlsim
from tb.system.stimuli import any_settings, spot_frame

__all__ = ["cocotb_speed", "show"]

#: The clock is made inside the Verilog, so that Python wakes only for octets.
_TIMING = ("--timing",)


@cache
def _capsule(config, clock_gated):
    return to_fast_verilog(Capsule(config, clock_gated), "capsule")


def _register_macros():
    """Verilog macros for ``rig.v`` that declare and connect the capsule's registers."""
    members = Capsule.registers.items()
    declared = " ".join(f"reg [{Shape.cast(member.shape).width - 1}:0] {name} = 0;"
                        for name, member in members)
    connected = ", ".join(f".{name}({name})" for name, _ in members)
    return f"`define REGISTERS {declared}\n`define REGISTER_PORTS {connected}\n"


def show(request, config, settings, images, divisor=1, clock_gated=True, faults=({},), **sensor):
    """Show frames to the RTL under cocotb.

    Parameters
    ----------
    request : pytest fixture, or anything with ``node.nodeid``
        Names the run's folder.
    config : :class:`hdl.config.Config`
        Constructor choices.
    settings : :class:`model.settings.Settings`
        Registers and tables.
    images : sequence of array (height, width) of uint8
        Frames, as many as ``rig.v`` has room for or fewer.
    divisor : :class:`int`
        Clocks per bit of the serial line.
    clock_gated : :class:`bool`
        Stop the spot side's clock while it is not busy, which is faster.
    faults : sequence of dict
        The frames are shown once for each of these faults of frame ``faulty``: ``row`` with
        ``extra`` pixels, ``lines`` that lack at its end.
    sensor : :class:`int`
        Registers of the sensor in ``rig.v``: blanking, number of the faulty frame.

    Returns
    -------
    (decoded frames, seconds from the first pixel to the last octet)
    """
    texts = {
        "rig.v": _register_macros() + (Path(__file__).parent / "rig.v").read_text(),
        "capsule.v": _capsule(config, clock_gated)}
    for name, value in (("WIDTH", config.width), ("HEIGHT", config.height)):
        head, _, rest = texts["rig.v"].partition(f"parameter {name} = ")
        end = len(rest) - len(rest.lstrip("0123456789"))
        texts["rig.v"] = f"{head}parameter {name} = {value}{rest[end:]}"
    with tempfile.TemporaryDirectory() as folder:
        pixels, case, answer = (Path(folder) / name for name in ("pixels.hex", "case", "answer"))
        pixels.write_bytes(b"\n".join(np.concatenate([image.ravel() for image in images])
                                      .tobytes().hex(" ").encode().split()))
        case.write_bytes(pickle.dumps({
            "settings": settings, "frames": len(images), "divisor": divisor, "sensor": sensor,
            "faults": faults}))
        hdlsim.run(
            request, "rig", "tb.system.tb_frames", verilog=texts,
            build_args=[*_TIMING, "-DGATED"] if clock_gated else _TIMING,
            plusargs=[f"+pixels={pixels}"],
            parameters={"case": str(case), "answer": str(answer)})
        return pickle.loads(answer.read_bytes())


def cocotb_speed(count=16):
    """Frames per second of the whole-frame bench, and clocks per frame."""
    config = PRESETS["capsule"]
    settings = any_settings(config.width, config.height, config.beams, report_rejected=False,
                            area_min=5)
    images = [spot_frame(config.width, config.height, seed, spots=49) for seed in range(count)]
    request = SimpleNamespace(node=SimpleNamespace(nodeid="bench"))
    frames, seconds = show(request, config, settings, images)
    return len(frames) / seconds, config.width * config.height + config.height + 17
