"""Real dots again, in images that were scaled, turned, brightened, compressed, blurred, or noisy.

``python -m tb.benchmark.changed_dots [FOLDER]`` prints F of each group for every change, truth and
regions changed alike. How far the default levels carry: the images themselves are few.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from tb.benchmark.dots import FOLDER, group_scores, images, score, settings

__all__ = ["CHANGES", "changed", "main", "scores"]

#: Pixels of an image's side at the most.
_LARGEST = 512


def _moved(image, matrix, size):
    return cv2.warpAffine(image, matrix, size, flags=cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REFLECT_101)


def _scaled(factor):
    def change(image, middle):
        """Around the middle of the regions, where the whole would be too large."""
        size = np.minimum(np.array(image.shape[::-1]) * factor, _LARGEST).astype(int)
        room = np.maximum(np.array(image.shape[::-1]) * factor - size, 0)
        corner = np.clip(middle * factor - size / 2, 0, room)
        matrix = np.hstack([factor * np.eye(2), (factor - 1) / 2 - corner[:, None]])
        if factor < 1:
            image = cv2.GaussianBlur(image, (0, 0), 0.4 / factor)
        return _moved(image, matrix, size.tolist()), matrix
    return change


def _turned(degrees):
    def change(image, _):
        height, width = image.shape
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, 1)
        return _moved(image, matrix, (width, height)), matrix
    return change


def _mirrored(image, _):
    return cv2.flip(image, 1), np.array([[-1.0, 0, image.shape[1] - 1], [0, 1, 0]])


def _levels(work):
    def change(image, _):
        grey = np.clip(np.rint(work(image.astype(float))), 0, 255).astype(np.uint8)
        return grey, np.eye(2, 3)
    return change


def _jpeg(quality):
    def change(image, _):
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.eye(2, 3)
    return change


def _noisy(sigma):
    return _levels(lambda grey: grey + np.random.default_rng(5).normal(0, sigma, grey.shape))


#: Each takes an image and the middle of its regions; gives the image, and the matrix (2, 3) that
#: takes positions there.
CHANGES = {
    "none": _levels(lambda grey: grey),
    **{f"scaled by {factor}": _scaled(factor) for factor in (0.7, 0.85, 1.2, 1.4)},
    "turned by 15 degrees": _turned(15), "mirrored": _mirrored,
    "half as bright": _levels(lambda grey: grey / 2),
    "1.5 x as bright": _levels(lambda grey: grey * 1.5),
    "40 brighter": _levels(lambda grey: grey + 40),
    "gamma 0.6": _levels(lambda grey: 255 * (grey / 255) ** 0.6),
    "gamma 1.6": _levels(lambda grey: 255 * (grey / 255) ** 1.6),
    "6 bits": _levels(lambda grey: grey // 4 * 4),
    "JPEG, quality 50": _jpeg(50), "JPEG, quality 30": _jpeg(30),
    "blurred by 0.8 px": _levels(lambda grey: cv2.GaussianBlur(grey, (0, 0), 0.8)),
    "noise of 4": _noisy(4), "noise of 8": _noisy(8)}


def changed(change, image, truth, regions):
    """Image, true dots and regions after a change; dots that are no longer inside are left out."""
    outlines = []
    for region in regions:
        if "hull" in region:
            outlines.append(np.array(region["hull"], float))
        else:
            left, right, top, bottom = region["u_v_range"]
            outlines.append(np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
    corners = np.concatenate(outlines)
    image, matrix = change(image, (corners.min(axis=0) + corners.max(axis=0)) / 2)

    def moved(positions):
        return positions @ matrix[:, :2].T + matrix[:, 2]

    truth = moved(truth)
    inside = ((truth >= 2) & (truth < np.array(image.shape[::-1]) - 2)).all(axis=1)
    return image, truth[inside], [{"hull": moved(outline).tolist()} for outline in outlines]


def scores(name, folder=FOLDER, **choices):
    """The score of each image of the folder after a change; ``choices`` as in `dots.scores_of`."""
    from calibration.spots import image_spots

    chosen = settings(**choices)
    for title, *about in images(folder):
        image, truth, regions = changed(CHANGES[name], *about)
        _, u, v, _ = image_spots(image, chosen)
        yield score(title, np.stack([u, v], axis=-1), truth, regions)


def main(arguments=None):
    """Print the scores of a folder after each change."""
    arguments = sys.argv[1:] if arguments is None else arguments
    folder = Path(arguments[0]) if arguments else FOLDER
    if not (folder / "sets.json").is_file():
        print(f"{folder} has no sets.json: name a folder of images with known dots.",
              file=sys.stderr)
        return 2
    for number, name in enumerate(CHANGES):
        groups = group_scores(scores(name, folder))
        if not number:
            print(f"{'change':22}", *(f"{group:>10}" for group in groups), f"{'mean':>7}")
        print(f"{name:22}", *(f"{value:10.3f}" for value in groups.values()),
              f"{np.mean(list(groups.values())):7.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
