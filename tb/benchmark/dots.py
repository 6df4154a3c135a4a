"""Finds the dots of real images with the golden model, and scores them.

``python -m tb.benchmark.dots [FOLDER]`` prints recall and precision of each image. FOLDER has
``sets.json``, which names the regions in which the truth of each image is complete, and for each
image ``NAME.png`` and ``NAME_truth.csv`` (``u_px, v_px``); by default ``shared/data/dots_real``
beside the repository. One setting for all images: that of the preset ``capsule`` out of reset.
"""

import csv
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from scripts.paths import ROOT

__all__ = ["FOLDER", "Score", "group_scores", "images", "main", "score", "scores_of", "settings"]

FOLDER = ROOT.parent / "shared" / "data" / "dots_real"
#: Images whose names begin alike are a group.
_GROUPS = ("vocal3d", "hle", "kinect", "discorpy", "endocal")
#: Pixels between a dot and the spot found for it, at most.
_REACH = 3.0


@dataclass(frozen=True)
class Score:
    """Shares of an image's dots that were found, and of the spots there that are dots."""

    name: str
    dots: int
    recall: float
    precision: float

    @property
    def f(self):
        """Harmonic mean of both."""
        return 2 * self.recall * self.precision / max(self.recall + self.precision, 1e-9)

    @property
    def group(self):
        """The group that the image belongs to; its own name if to none."""
        return next((group for group in _GROUPS if self.name.startswith(group)), self.name)


def settings(**changes):
    """Settings out of reset, with the table that centres need."""
    from calibration.reciprocal import reciprocal_table
    from model.settings import Settings

    return Settings(reciprocal=tuple(reciprocal_table()), **changes)


def images(folder=FOLDER):
    """Yield name, image, true dots (n x 2, pixels) and regions of each image of the folder."""
    for name, about in json.loads((folder / "sets.json").read_text()).items():
        image = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
        with open(folder / f"{name}_truth.csv", newline="") as file:
            truth = np.array([[float(row["u_px"]), float(row["v_px"])]
                              for row in csv.DictReader(file)])
        yield name, image, truth, about["regions"]


def _inside(places, regions):
    """Which places lie in one of the regions."""
    inside = np.zeros(len(places), bool)
    for region in regions:
        if "hull" in region:
            hull = np.array(region["hull"], np.float32)
            inside |= np.array([cv2.pointPolygonTest(hull, (float(u), float(v)), False) >= 0
                                for u, v in places], bool)
        else:
            left, right, top, bottom = region["u_v_range"]
            u, v = places.T
            inside |= (left <= u) & (u <= right) & (top <= v) & (v <= bottom)
    return inside


def score(name, found, truth, regions):
    """Compare spots with dots: a dot is found if it and a spot are each other's nearest.

    Parameters
    ----------
    name : :class:`str`
        The image's name.
    found, truth : arrays (n, 2)
        Places in pixels.
    regions : list of :class:`dict`
        Where the truth is complete.

    Returns
    -------
    :class:`Score`
    """
    truth = truth[_inside(truth, regions)]
    matched = 0
    if len(found) and len(truth):
        distance = np.linalg.norm(truth[:, None] - found[None], axis=-1)
        nearest = distance.argmin(1)
        dots = np.arange(len(truth))
        matched = np.count_nonzero((distance[dots, nearest] <= _REACH)
                                   & (distance.argmin(0)[nearest] == dots))
    spots = max(np.count_nonzero(_inside(found, regions)) if len(found) else 0, matched, 1)
    return Score(name, len(truth), matched / len(truth), matched / spots)


def group_scores(scores):
    """Mean F of each group, by its name."""
    groups = {}
    for each in scores:
        groups.setdefault(each.group, []).append(each.f)
    return {name: float(np.mean(values)) for name, values in groups.items()}


def scores_of(folder=FOLDER, **changes):
    """Yield the score of each image of the folder; ``changes`` to the settings out of reset."""
    from calibration.spots import image_spots

    chosen = settings(**changes)
    for name, image, truth, regions in images(folder):
        _, u, v, _ = image_spots(image, chosen)
        yield score(name, np.stack([u, v], axis=-1), truth, regions)


def main(arguments=None):
    """Print the scores of a folder."""
    arguments = sys.argv[1:] if arguments is None else arguments
    folder, scores = Path(arguments[0]) if arguments else FOLDER, []
    if not (folder / "sets.json").is_file():
        print(f"{folder} has no sets.json: name a folder of images with known dots.",
              file=sys.stderr)
        return 2
    print(f"{'image':14} {'dots':>5} {'recall':>7} {'precision':>9} {'F':>6}")
    for each in scores_of(folder):
        scores.append(each)
        print(f"{each.name:14} {each.dots:5} {each.recall:7.3f} {each.precision:9.3f} "
              f"{each.f:6.3f}")
    groups = group_scores(scores)
    for name, value in groups.items():
        print(f"{name:14} {'':23} {value:6.3f}")
    print(f"{'mean of groups':14} {'':23} {np.mean(list(groups.values())):6.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
