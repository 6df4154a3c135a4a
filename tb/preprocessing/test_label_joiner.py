# amaranth: UnusedElaboratable=no
"""Labels that are joined in any order, against the model."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest

from hdl.preprocessing.label_joiner import LabelJoiner
from model.preprocessing.label_joiner import join_labels
from tb.hdlsim import run
from tb.native_block import NativeBlock, pack
from tb.preprocessing.joiner_rig import JoinerCommand, JoinerRig, Kind

PAIRS_OF_FIVE = tuple(combinations(range(6), 2))


@cache
def joiner(labels):
    return NativeBlock(JoinerRig(labels))


class Script:
    """Commands, and what has to come of them."""

    def __init__(self):
        self.commands, self.wanted, self.names = [], [], []

    def _add(self, kind, one=0, other=0):
        self.commands.append((kind.value, one, other))

    def frame(self, events, name):
        """A frame of ``events``: None gives out a label, a pair is joined."""
        used, pairs = 0, []
        self._add(Kind.CLEAR)
        for event in events:
            if event is None:
                used += 1
                self._add(Kind.ALLOCATE)
                self.wanted.append(used)
                self.names.append(name)
            else:
                pairs.append(event)
                self._add(Kind.PAIR, *map(int, event))
        self._add(Kind.RESOLVE)
        for label, root in enumerate(join_labels(used, pairs)):
            self._add(Kind.LOOKUP, label)
            self.wanted.append(int(root))
            self.names.append(f"{name}, label {label}")

    def check(self, labels, gap=0.0, stall=0.0, seed=1):
        """Run it; every word must be the model's. Returns the clocks in which commands were taken.
        """
        kind, one, other = np.array(self.commands).T
        block = joiner(labels)
        block.reset()
        out = block.stream(pack(JoinerCommand, kind=kind, one=one, other=other), gap, stall, seed,
                           idle=20, limit=4 * labels + 100)
        got = out.words[:, 0].tolist()
        for position, (mine, wanted) in enumerate(zip(got, self.wanted, strict=False)):
            assert mine == wanted, f"{self.names[position]}: {mine}, not {wanted}"
        assert len(got) == len(self.wanted)
        return kind, out.taken


@pytest.mark.parametrize("seed", [1, 2])
def test_every_graph_of_five_labels(seed):
    """All 32,768 sets of pairs among the labels 0 to 5, in a random order and direction."""
    rng = np.random.default_rng(seed)
    script = Script()
    for number in rng.permutation(1 << len(PAIRS_OF_FIVE))[seed % 2::2]:
        pairs = [pair[::int(rng.choice([-1, 1]))] for bit, pair in enumerate(PAIRS_OF_FIVE)
                 if number >> bit & 1]
        rng.shuffle(pairs)
        script.frame([None] * 5 + [tuple(pair) for pair in pairs], f"graph {number}")
    script.check(5)


@pytest.mark.parametrize(("labels", "gap", "stall"), [
    (1, 0, 0), (2, 0.3, 0.3), (7, 0, 0), (30, 0, 0.5), (255, 0.5, 0), (1023, 0, 0)])
def test_labels_are_given_out_meanwhile(labels, gap, stall):
    """Frames with few and with all labels; pairs come as soon as both labels exist."""
    rng = np.random.default_rng(labels)
    script = Script()
    for number in range(max(4, 2000 // labels)):
        events, used, density = [], 0, rng.random()
        while used < labels * (1 if number % 3 else rng.random()):
            if used and rng.random() < density:
                near = rng.integers(max(0, used - 8), used + 1, 2)
                far = rng.integers(0, used + 1, 2)
                events.append(tuple(near if rng.random() < 0.7 else far))
            else:
                events.append(None)
                used += 1
        script.frame(events, f"frame {number}")
    script.check(labels, gap, stall, labels)


def test_long_chains():
    """Labels in a row, joined from either end or the middle, and stars."""
    labels, script = 64, Script()
    row = [(label, label + 1) for label in range(1, labels)]
    middle = sorted(row, key=lambda pair: abs(pair[0] - labels // 2))
    for name, pairs in {
            "up": row, "down": row[::-1], "from the middle": middle, "to it": middle[::-1],
            "star": [(1, label) for label in range(2, labels)],
            "star of the last": [(labels, label) for label in range(labels - 1, 0, -1)],
            "all to 0": [(label, 0) for label in range(labels, 0, -1)],
            "the same again": [(3, 4)] * 9}.items():
        script.frame([None] * labels + pairs, name)
    script.check(labels)


def test_clocks():
    """Unjoined labels take three clocks, labels with one parent two; resolving takes 2 n + 1."""
    for used in (0, 1, 7, 30):
        script = Script()
        script.frame([None] * used, "no pairs")
        kind, taken = script.check(30)
        resolve = list(kind).index(Kind.RESOLVE.value)
        assert taken[resolve] - taken[resolve - 1] == 2 * used + 1
    for pairs, clocks in (([(n, n + 1) for n in range(1, 29, 2)], 3),
                          ([(n, n) for n in range(1, 29)], 2)):
        script = Script()
        script.frame([None] * 30 + pairs, "pairs")
        kind, taken = script.check(30)
        # One is joined and one is buffered at once; the others wait for their turn.
        assert set(np.diff(taken[kind == Kind.PAIR.value])[2:]) == {clocks}


@pytest.mark.parametrize("labels", [3, 1023])
def test_label_joiner(request, labels):
    run(request, "label_joiner", "tb.preprocessing.tb_label_joiner",
        component=LabelJoiner(labels), parameters={"labels": labels})


@pytest.mark.parametrize("labels", [0, 32768, "foo"])
def test_refuses_parameters(labels):
    with pytest.raises(ValueError) as caught:
        LabelJoiner(labels)
    assert str(caught.value) == f"Labels must be an integer from 1 to 32767, not {labels!r}"
