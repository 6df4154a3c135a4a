"""How long a texture takes over the line, beside the points of every frame.

The pictures are those of ``shared/data/texture`` beside the repository, scaled to 352 x 288; where
there are none, textures of simulated tissue.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from model.bayer import channels
from scripts.paths import ROOT
from tb.benchmark import line_load

__all__ = ["LINES", "Times", "longest_frame", "measure", "pictures", "simulated_tissue"]

#: Rig, its beams, and the speed of the line.
LINES = (("endoscope", 49, line_load.BAUD), ("dense", 361, 1_000_000))
_FOLDER = ROOT.parent / "shared" / "data" / "texture"
_SIZE = 352, 288


@dataclass(frozen=True)
class Times:
    """Seconds for each picture: until the coarse one is there, and the whole."""

    coarse: np.ndarray
    whole: np.ndarray


def pictures(mosaic=False):
    """What the pictures are, and a list of arrays (288, 352) of uint8.

    With ``mosaic``, they are seen through colour filters, RGGB.
    """
    paths = sorted(_FOLDER.glob("*.png"))
    if not paths:
        return "simulated tissue", [simulated_tissue(seed, mosaic) for seed in range(4)]
    what = f"{len(paths)} pictures of {_FOLDER}"
    if not mosaic:
        return what, [cv2.resize(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), _SIZE)
                      for path in paths]
    site = channels("RGGB", *_SIZE[::-1])[:, :, None]
    return what, [np.take_along_axis(
        cv2.resize(cv2.imread(str(path), cv2.IMREAD_COLOR), _SIZE)[:, :, ::-1], site, axis=2)[
            :, :, 0] for path in paths]


def simulated_tissue(seed=1, mosaic=False):
    """A texture as the rig ``endoscope`` sees it."""
    from model.optics import render, scenes
    from model.optics.rigs import RIGS
    rng = np.random.default_rng(seed)
    rig = RIGS["endoscope"].with_filters("RGGB" if mosaic else None)
    scene, = scenes.sequence("tissue", rig, 1, rng)
    return render.texture_frame(rig, scene, rng)


def longest_frame(rig, beams):
    """The longest of a few frames in which all beams are ok points."""
    frames = [frame for frame in line_load.realistic_frames([1], rig)
              if np.count_nonzero(frame.points["status"] == 0) == beams]
    return max(frames, key=line_load.points_octets)


def measure(images, frame, baud, bound, mosaic=False):
    """:class:`Times` of images beside the points of ``frame``, or None, in every pair."""
    return Times(*np.transpose([
        line_load.refresh_seconds(image, frame, baud, bound=bound, mosaic=mosaic)
        for image in images]))
