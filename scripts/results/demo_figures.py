"""The figures of the demonstration: a file of them, and the sentence that the README quotes.

The sentence stands between the lines ``<!-- demo: figures -->`` and ``<!-- end -->``.
"""

import re

__all__ = ["figures", "sentence", "updated"]

_MARKED = re.compile(r"(<!-- demo: figures -->\n).*?\n(<!-- end -->)", re.S)


def figures(frames, accuracy):
    """What is kept of a demonstration, as plain numbers.

    Parameters
    ----------
    frames : :class:`int`
        Number of frames with the laser on that were compared with the truth.
    accuracy : :class:`scripts.results.accuracy.Accuracy`
        The comparison.

    Returns
    -------
    dict
        ``frames, beams, ok_points`` are numbers, the others parts of 1.
    """
    return {
        "frames": frames, "beams": accuracy.expected, "ok_points": len(accuracy.points),
        "found": accuracy.found, "wrong": accuracy.wrong, "mean_error": accuracy.mean,
        "median_error": accuracy.median, "worst_error": accuracy.worst}


def sentence(summary):
    """The :func:`figures` in words.

    The noise differs with the frame at which the reader joins: shares are rounded to 0.1 %, the
    error to one digit.
    """
    wrong = "none" if summary["wrong"] == 0 else f"{100 * summary['wrong']:.1f} % of the points"
    return (f"{summary['frames']} frames with the laser on: {100 * summary['found']:.3g} % of "
            f"their {summary['beams']} beams found, {wrong} wrong, mean depth error "
            f"{100 * summary['mean_error']:.1g} %.")


def updated(text, summary):
    """A README with the sentence of these figures."""
    return _MARKED.sub(lambda found: f"{found[1]}{sentence(summary)}\n{found[2]}", text)
