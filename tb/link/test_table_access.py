# amaranth: UnusedElaboratable=no
"""Words of all tables: what was written is read, octet by octet, in both banks."""

import random
from functools import cache

import numpy as np
import pytest

from hdl.link.table_access import TableAccess
from model.link.table_access import TableStore
from tb.link.table_rig import Access, TableRig
from tb.native_block import NativeBlock, pack

BEAMS, PIXELS = 128, 64 * 48
#: Clocks between accesses: the tables want four from one to the next.
PAUSE = 3


@cache
def block_of(preset):
    store = TableStore(preset, BEAMS, PIXELS)
    return NativeBlock(TableRig(preset, store.counts[-1]))


class Rig:
    """The block with its memories, and the model."""

    def __init__(self, preset):
        self.block, self.store = block_of(preset), TableStore(preset, BEAMS, PIXELS)
        self.block.reset()
        self.block.set(ready=1, flicker=0, bank=0)
        for number, count in enumerate(self.store.counts):
            for _ in range(2):
                self.access([(number, address, 0) for address in range(count)])
                self.swap()

    def swap(self):
        self.store.swap()
        self.block.set(bank=self.store.bank)

    def access(self, requests):
        """Writes (table, address, word) and reads (table, address, None, octet), in their order.

        Everything that is read is the model's. Gives the clocks in which they were done.
        """
        requests = [(*request, 0)[:4] for request in requests]
        wanted = []
        for number, address, word, octet in requests:
            if word is None:
                wanted.append(self.store.octets(number, address, 1)[octet])
            else:
                self.store.write(number, address, word)
        numbers, addresses, words, octets = zip(*requests, strict=True)
        beats = self.block.stream(words_of(numbers, addresses, words, octets), idle=8,
                                  pauses=np.full(len(words), PAUSE))
        assert beats.words[:, 0].tolist() == wanted
        assert not self.block.get("wrong")
        return beats.taken

    def random_requests(self, rng, count):
        for _ in range(count):
            table = rng.choice(self.store.kinds)
            size = self.store.counts[table.number]
            address = rng.choice([0, 1, size - 1, rng.randrange(size)])
            if rng.random() < 0.4:
                yield table.number, address, rng.getrandbits(table.bits)
            else:
                yield table.number, address, None, rng.randrange(table.octets)


def words_of(numbers, addresses, words, octets):
    """Beats of :class:`Access`."""
    beats = pack(Access, write=[word is not None for word in words], number=numbers,
                 address=addresses, octet=octets)
    start = Access.as_shape()["word"].offset
    for row, word in zip(beats, words, strict=True):
        for part in range(len(row)):
            row[part] |= ((word or 0) << start >> 32 * part) & 0xFFFFFFFF
    return beats


@pytest.mark.parametrize("flicker", [0, 1])
@pytest.mark.parametrize("preset", ["capsule", "paper"])
def test_what_was_written_is_read(preset, flicker):
    rig, rng = Rig(preset), random.Random(f"{preset} {flicker}")
    rig.block.set(flicker=flicker)
    for _ in range(10):
        rig.access([*rig.random_requests(rng, 300)])
        rig.swap()


@pytest.mark.parametrize("preset", ["capsule", "paper"])
def test_clocks(preset):
    """A write takes one clock and a read four; outside it is two, and one more than the answer."""
    rig = Rig(preset)
    for table in rig.store.kinds:
        inside = table.banked or table.name == "reciprocal"
        writes = rig.access([(table.number, 1, value) for value in range(20)])
        assert set(np.diff(writes)) == {PAUSE + (1 if inside else 2)}
        reads = rig.access([(table.number, 1, None, n % table.octets) for n in range(20)])
        assert set(np.diff(reads)) == {PAUSE + (TableAccess.latency + 1 if inside else 3)}


def test_accesses_wait_for_the_tables():
    rig = Rig("capsule")
    rig.block.set(ready=0)
    with pytest.raises(AssertionError, match="stuck: 500 clocks"):
        rig.block.stream(words_of([0], [0], [5], [0]), limit=500)
    rig.block.set(ready=1)
    rig.block.reset()


def test_wrong_preset():
    with pytest.raises(ValueError) as caught:
        TableAccess("foo")
    assert str(caught.value) == "Preset must be one of capsule, paper, not 'foo'"
