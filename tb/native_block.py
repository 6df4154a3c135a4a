"""A Verilated block behind ``ctypes``: whole streams of words without a Python call per clock.

For the benches that need millions of clocks; the protocol itself is the cocotb benches' matter.
"""

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from amaranth.lib import data

from hdl.export import flat_ports
from scripts.simulation.library import build
from tb.verilog import cached_verilog

__all__ = ["Beats", "Design", "NativeBlock", "compile_block", "pack", "unpack"]

_HARNESS = r"""
#include "Vblock_under_test.h"
#include "verilated.h"
#include <cstdint>
#include <cstring>

template <class T> void put(T& port, const uint32_t* word) {
    if constexpr (sizeof(T) <= 4) port = static_cast<T>(word[0]);
    else port = static_cast<T>(word[0] | static_cast<uint64_t>(word[1]) << 32);
}
template <std::size_t N> void put(VlWide<N>& port, const uint32_t* word) {
    for (std::size_t i = 0; i < N; ++i) port[i] = word[i];
}
template <class T> void get(const T& port, uint32_t* word) {
    word[0] = static_cast<uint32_t>(port);
    if constexpr (sizeof(T) > 4) word[1] = static_cast<uint32_t>(port >> 32);
}
template <std::size_t N> void get(const VlWide<N>& port, uint32_t* word) {
    for (std::size_t i = 0; i < N; ++i) word[i] = port[i];
}

struct Block {
    VerilatedContext context;
    Vblock_under_test top{&context, "TOP"};
    uint64_t clocks = 0, state = 0;
    bool waiting = false;
    uint32_t held[OUT_WORDS] = {};
    uint32_t random() {  // xorshift64*
        state ^= state >> 12; state ^= state << 25; state ^= state >> 27;
        return static_cast<uint32_t>((state * 0x2545F4914F6CDD1DULL) >> 32);
    }
    void settle() { top.clk = 0; top.eval(); }
    void edge() { top.clk = 1; top.eval(); ++clocks; }
};

extern "C" {
Block* block_new() { return new Block; }
void block_free(Block* b) { b->top.final(); delete b; }
uint64_t block_clocks(Block* b) { return b->clocks; }
void block_reset(Block* b, int clocks) {
    b->top.rst = 1;
    b->top.i_valid = 0;
    b->top.o_ready = 0;
    while (clocks-- > 0) b->settle(), b->edge();
    b->top.rst = 0;
    b->waiting = false;
}
void block_set(Block* b, int port, const uint32_t* word) { switch (port) { SETTERS } }
void block_get(Block* b, int port, uint32_t* word) { b->settle(); switch (port) { GETTERS } }

// Pushes `count` words, then runs until `idle` clocks have passed. Returns the number of words that
// came out, or -1: more than `room`, -2: valid fell or a word changed before it was taken,
// -3: more than `limit` clocks without a word taken on either side. gap and stall: chances in 2^32.
int64_t block_stream(Block* b, const uint32_t* words, uint64_t count, const uint32_t* pauses,
                     uint64_t gap, uint64_t stall, uint64_t seed, uint64_t idle, uint64_t limit,
                     uint64_t* taken, uint32_t* out, uint64_t* out_clock, uint64_t room) {
    auto& top = b->top;
    b->state = seed * 0x9E3779B97F4A7C15ULL + 0x1234567;
    uint64_t next = 0, got = 0, since = 0, pause = count ? pauses[0] : 0;
    bool valid = false;
    while (next < count || idle > 0) {
        if (next == count) --idle;
        if (!valid && next < count) {
            if (pause) --pause;
            else if (!gap || b->random() >= gap) {
                valid = true;
                put(top.i_payload, words + next * IN_WORDS);
            }
        }
        top.i_valid = valid;
        top.o_ready = !stall || b->random() >= stall;
        b->settle();
        bool in = valid && top.i_ready, produced = top.o_valid;
        uint32_t word[OUT_WORDS] = {};
        if (produced) get(top.o_payload, word);
        if (b->waiting && (!produced || std::memcmp(word, b->held, sizeof word))) return -2;
        b->waiting = produced && !top.o_ready;
        std::memcpy(b->held, word, sizeof word);
        if (produced && top.o_ready) {
            if (got == room) return -1;
            std::memcpy(out + got * OUT_WORDS, word, sizeof word);
            out_clock[got++] = b->clocks;
            since = 0;
        }
        if (in) {
            taken[next++] = b->clocks;
            valid = false;
            since = 0;
            if (next < count) pause = pauses[next];
        }
        b->edge();
        if (next < count && ++since > limit) return -3;
    }
    top.i_valid = 0;
    return got;
}
}
"""


@dataclass
class Beats:
    """What came out of a stream, and when.

    ``words`` are rows of 32-bit words, least significant first; ``clocks`` the clock in which each
    was taken. ``taken`` holds the clock in which each input word was taken.
    """

    words: np.ndarray
    clocks: np.ndarray
    taken: np.ndarray

    @property
    def accepted(self):
        """Input words taken before the clock in which each output word was."""
        return np.searchsorted(self.taken, self.clocks)

    def fields(self, shape):
        """The words as :func:`unpack` reads them."""
        return unpack(shape, self.words)


def _members(shape, at=0, prefix=""):
    """(name, first bit, width) of every plain field of a payload."""
    for name, field in data.Layout.cast(shape):
        start, path = at + field.offset, f"{prefix}{name}"
        try:
            yield from _members(field.shape, start, f"{path}_")
        except TypeError:
            yield path, start, field.width


def pack(shape, **fields):
    """Payload words from arrays of fields; nested fields are joined with one underscore.

    Fields that are not given are 0. Returns uint32 of shape (length, words), least significant
    first.
    """
    layout = data.Layout.cast(shape)
    columns = {name: np.atleast_1d(value) for name, value in fields.items()}
    length = max(len(value) for value in columns.values())
    words = np.zeros((length, -(-layout.size // 32)), dtype=np.uint32)
    for name, start, width in _members(shape):
        if name in columns:
            value = columns.pop(name).astype(np.int64).astype(np.uint64)
            for word in range(start // 32, (start + width - 1) // 32 + 1):
                part = value & np.uint64((1 << width) - 1)
                shift = start - 32 * word
                part = part << np.uint64(shift) if shift >= 0 else part >> np.uint64(-shift)
                words[:, word] |= part.astype(np.uint32)
    if columns:
        raise KeyError(f"The payload has no fields {sorted(columns)}")
    return words


def unpack(shape, words):
    """A structured array (int64 fields, not sign-extended) of payload words, inverse of pack."""
    members = list(_members(shape))
    fields = np.zeros(len(words), dtype=[(name, np.int64) for name, _, _ in members])
    for name, start, width in members:
        for word in range(start // 32, (start + width - 1) // 32 + 1):
            part, shift = words[:, word].astype(np.uint64), start - 32 * word
            part = part >> np.uint64(shift) if shift >= 0 else part << np.uint64(-shift)
            fields[name] |= (part & np.uint64((1 << width) - 1)).astype(np.int64)
    return fields


@dataclass(frozen=True)
class Design:
    """A compiled block: (index, width, direction) of each port by its name, and its library."""

    ports: dict
    library: Path


def compile_block(component, device=None):
    """A :class:`Design`, for benches that make many blocks of one.

    Parameters
    ----------
    component : :class:`amaranth.lib.wiring.Component`
        Exported as :func:`hdl.export.to_verilog` does.
    device : tuple of three :class:`str` or None
        C++ of what is on the block's pins: its definition, its declaration, and what it does with
        ``top`` in each half clock.
    """
    ports = {name: (index, len(value), direction) for index, (name, (value, direction))
             in enumerate(flat_ports(component).items())}
    setters, getters = [], []
    for name, (index, _, direction) in ports.items():
        cases, call = (setters, "put") if direction == "i" else (getters, "get")
        cases.append(f"case {index}: {call}(b->top.{name}, word); break;")
    words = {name: -(-ports[f"{name}_payload"][1] // 32) for name in "io"}
    harness = (f"#define IN_WORDS {words['i']}\n#define OUT_WORDS {words['o']}\n"
               f"#define SETTERS {' '.join(setters)}\n#define GETTERS {' '.join(getters)}\n"
               + _HARNESS)
    if device is not None:
        definition, declaration, half_clock = device
        harness = definition + harness.replace(
            "uint64_t clocks", f"{declaration}\n    uint64_t clocks", 1).replace(
            "top.eval();", f"top.eval(); {half_clock}")
    verilog = cached_verilog(component, "block_under_test")
    return Design(ports, build("block_under_test", verilog, lambda: verilog, harness))


class NativeBlock:
    """A block with one input stream ``i`` and one output stream ``o``, Verilated.

    Parameters
    ----------
    component : :class:`amaranth.lib.wiring.Component` or :class:`Design`
        Only the clock ``clk`` is driven.
    device : tuple of three :class:`str` or None
        As :func:`compile_block` takes it.

    Every new object starts from power-up; :meth:`reset` it where that matters.
    """

    def __init__(self, component, device=None):
        design = component if isinstance(component, Design) else compile_block(component, device)
        self._ports = design.ports
        self._in_words = -(-self._ports["i_payload"][1] // 32)
        self._out_words = -(-self._ports["o_payload"][1] // 32)
        self._library = library = ctypes.CDLL(str(design.library))
        library.block_new.restype = ctypes.c_void_p
        library.block_clocks.restype = ctypes.c_uint64
        library.block_stream.restype = ctypes.c_int64
        self._handle = ctypes.c_void_p(library.block_new())

    def __del__(self):
        if getattr(self, "_handle", None):
            self._library.block_free(self._handle)
            self._handle = None

    @property
    def clocks(self):
        """Clocks since power-up."""
        return self._library.block_clocks(self._handle)

    def reset(self, clocks=2):
        """Hold ``rst`` for some clocks, streams idle."""
        self._library.block_reset(self._handle, clocks)

    def set(self, **values):
        """Set plain inputs."""
        for name, value in values.items():
            index, width, direction = self._ports[name]
            if direction != "i":
                raise ValueError(f"Port {name!r} is an output")
            count = -(-width // 32)
            words = (ctypes.c_uint32 * (count + 1))(
                *(value >> 32 * word & 0xFFFFFFFF for word in range(count)))
            self._library.block_set(self._handle, index, words)

    def get(self, name):
        """Value of an output."""
        index, width, _ = self._ports[name]
        count = -(-width // 32)
        words = (ctypes.c_uint32 * (count + 1))()
        self._library.block_get(self._handle, index, words)
        return sum(words[word] << 32 * word for word in range(count))

    def stream(self, words, gap=0.0, stall=0.0, seed=1, pauses=None, idle=0, limit=100_000):
        """Push payload words, collect what comes out, and run on for ``idle`` clocks.

        Parameters
        ----------
        words : array of uint32, shape (length, 32-bit words of ``i``), see :func:`pack`
        gap, stall : :class:`float`
            Chance in each clock that no new word is offered, or that none is taken.
        seed : :class:`int`
            Seed of gaps and stalls.
        pauses : array of int, optional
            Clocks to wait before each word, besides ``gap``.
        idle : :class:`int`
            Clocks after the last word was taken.
        limit : :class:`int`
            Clocks without a word in or out after which the block counts as stuck.

        Returns
        -------
        :class:`Beats`

        Raises
        ------
        AssertionError
            If the block withdraws or changes a word before it was taken, or is stuck.
        """
        words = np.ascontiguousarray(words, dtype=np.uint32).reshape(-1, self._in_words)
        count = len(words)
        pauses = np.ascontiguousarray(np.zeros(count) if pauses is None else pauses, np.uint32)
        room = 4 * count + idle + 16
        taken = np.zeros(count, np.uint64)
        out = np.zeros((room, self._out_words), np.uint32)
        clocks = np.zeros(room, np.uint64)

        def pointer(array):
            return array.ctypes.data_as(ctypes.c_void_p)

        def chance(value):
            return ctypes.c_uint64(int(value * 2**32))

        got = self._library.block_stream(
            self._handle, pointer(words), ctypes.c_uint64(count), pointer(pauses), chance(gap),
            chance(stall), ctypes.c_uint64(seed), ctypes.c_uint64(idle), ctypes.c_uint64(limit),
            pointer(taken), pointer(out), pointer(clocks), ctypes.c_uint64(room))
        if got < 0:
            raise AssertionError({
                -1: "more words came out than there is room for",
                -2: "a word was withdrawn or changed before it was taken",
                -3: f"stuck: {limit} clocks without a word in or out"}[got])
        return Beats(out[:got].copy(), clocks[:got].astype(np.int64), taken.astype(np.int64))
