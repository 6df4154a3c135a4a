"""The screen's picture for the documents: ``python -m tb.display.picture`` writes docs/vga.png.

A simulated polyp and its texture, taken from the demonstration's capture; spots as the golden model
finds them. What is written is what a monitor saw on the pins.
"""

import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

from calibration import file
from model.capsule import Capsule
from scripts import demo
from scripts.paths import ROOT
from tb.display.screens import play

__all__ = ["main", "rendered_scene"]

#: Frame of the capture, and screens to wait for: the texture is stored in the third.
_FRAME, _SCREENS = 3, 4


def rendered_scene(request, folder, capture, calibration):
    """The last screen (480, 640, 3), and how many spots of it are ok and not."""
    images = np.stack([
        cv2.imread(str(capture / "frames" / f"{_FRAME:04}_{kind}.png"), cv2.IMREAD_GRAYSCALE)
        for kind in ("ir", "texture")])
    _, height, width = images.shape
    model = Capsule(file.load(calibration).settings, width, height)
    model.frame(images[0])  # it learns its threshold
    points = model.frame(images[0]).points
    spots = [(int(point["u"]), int(point["v"]), int(point["status"] == 0)) for point in points]
    show = play(request, folder, images, [spots], _SCREENS, sync_ps=62_500, period=2,
                blanking=320_000 - 2 * width * height, delay=3000)
    assert show.torn == 0 and show.overlaid[-1] and show.numbers[-1] % 2
    good = sum(ok for _, _, ok in spots)
    return show.pictures[-1], good, len(spots) - good


def main(target=ROOT / "docs" / "vga.png"):
    capture, calibration = demo.prepare(ROOT / "out" / "demo")
    with tempfile.TemporaryDirectory() as folder:
        picture, good, others = rendered_scene(
            SimpleNamespace(node=SimpleNamespace(nodeid="tb.display.picture")), Path(folder),
            capture, calibration)
    cv2.imwrite(str(target), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    print(f"{target}: {good} spots are ok, {others} are not")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
