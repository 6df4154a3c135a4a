"""Runs the rig of camera, frame store and screen, and says what was shown."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hdl.acquisition.frame_memory import FrameMemory
from hdl.display.vga import VGA
from hdl.export import to_verilog
from model.display.vga import display
from tb.display.monitor import Monitor
from tb.hdlsim import run

__all__ = ["LENGTH", "Show", "play"]

RIG = Path(__file__).with_name("screen_rig.v")
#: Words of a list of spots, its end included.
LENGTH = 160
#: Clocks in which a frame or list that ends may be seen by a request, or not.
UNSURE = 30
#: From a request to the first pixel of the screen after it: 45 lines, and the way to the pins.
BLANKING = 45 * 800


@dataclass
class Show:
    """What was seen, screen by screen.

    ``numbers`` has the frame's number or None, ``overlaid`` whether its overlay was there. ``torn``
    counts the screens that are no frame's picture at all.
    """

    pictures: list
    numbers: list = field(default_factory=list)
    overlaid: list = field(default_factory=list)
    torn: int = 0


def _hex(path, values, digits):
    path.write_text("\n".join(f"{int(value):0{digits}x}" for value in values) + "\n")


def play(request, folder, images, lists, screens, pairs=True, stores=None, colour_bits=8, **rig):
    """Show images, and compare every pixel of every screen with the model.

    Parameters
    ----------
    images : array (n, height, width) of uint8
        They are shown in turn.
    lists : list of [(u, v, ok), ...]
        Spots of frame k, likewise.
    screens : :class:`int`
        For so long.
    stores : dict of Verilog texts, optional
        Module ``frame_store`` with an external memory; by default it is a :class:`.FrameMemory`
        of three banks.
    colour_bits : :class:`int`
        Bits of a colour pin.
    rig
        Registers of the rig.
    """
    count, height, width = images.shape
    _hex(folder / "pixels.hex", images.ravel(), 2)
    words = np.zeros((len(lists), LENGTH), object)
    for place, spots in enumerate(lists):
        words[place, :len(spots)] = [2 * ok | u << 2 | v << 20 for u, v, ok in spots]
        words[place, len(spots)] = 1
    _hex(folder / "spots.hex", words.ravel(), 10)
    files = {name: folder / f"{name}.{kind}" for name, kind in (
        ("pixels", "hex"), ("spots", "hex"), ("record", "bin"), ("log", "txt"))}
    sram = stores is not None
    stores = stores or {
        "frame_store.v": to_verilog(FrameMemory(width, height, 3), "frame_store")}
    run(request, "screen_rig", "tb.display.tb_screen",
        verilog={**stores, "vga.v": to_verilog(VGA(width, height, colour_bits), "vga"),
                 "screen_rig.v": RIG.read_text()},
        parameters={"rig": {"screens": screens, "pairs": int(pairs), **rig},
                    "sram": sram},
        build_args=["--timing", "--no-sched-zero-delay", "-O3",
                    f"-GWIDTH={width}", f"-GHEIGHT={height}", f"-GIMAGES={count}",
                    f"-GLISTS={len(lists)}", f"-GLENGTH={LENGTH}",
                    f"-GCOLOUR={colour_bits}", *["-DSRAM"] * sram],
        plusargs=[f"+{name}={path}" for name, path in files.items()])

    pins = np.fromfile(files["record"], np.uint8).reshape(-1, 4)
    red, green, blue, flags = pins.T
    monitor = Monitor(red, green, blue, flags & 1, flags >> 1 & 1, flags >> 2 & 1)
    ended = {"frame": {}, "spots": {}}
    for line in files["log"].read_text().splitlines():
        kind, number, clock = line.split()
        ended[kind][int(number)] = int(clock)

    show = Show(monitor.pictures)
    for picture, start in zip(monitor.pictures, monitor.starts, strict=True):
        asked = start - BLANKING
        number, overlaid = _recognise(picture, asked, ended, images, lists, pairs, colour_bits)
        show.torn += number == "torn"
        show.numbers.append(number)
        show.overlaid.append(overlaid)
    return show


def _recognise(picture, asked, ended, images, lists, pairs, colour_bits):
    """Number of the frame that was on the screen, and whether with its overlay; or "torn"."""
    frames = [number for number, clock in ended["frame"].items() if clock < asked - UNSURE]
    newest = max(frames, default=None)
    also = [number for number, clock in ended["frame"].items()
            if abs(clock - asked) <= UNSURE]
    for number in [newest, *also]:
        if number is None:
            if np.array_equal(picture, display(None)):
                return None, False
            continue
        owner = number - (pairs and number % 2)
        clock = ended["spots"].get(owner, 1 << 60)
        for overlaid in (True, False):
            if (clock > asked + UNSURE) if overlaid else (clock < asked - UNSURE):
                continue  # its list had not ended, or had
            spots = lists[owner % len(lists)] if overlaid else ()
            if np.array_equal(picture, display(
                    images[number % len(images)], spots, colour_bits=colour_bits)):
                return number, overlaid
    return "torn", False
