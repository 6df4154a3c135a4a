"""Bit errors on the line, and what they cost: the figure of the link."""

import random
from dataclasses import dataclass

import numpy as np

from hdl.protocol import GAP_CHARACTERS
from scripts.host.decoder import Decoder
from scripts.host.framing import Deframer
from tb.link.wire import Wire, stream

__all__ = ["Figures", "measure"]


@dataclass(frozen=True)
class Figures:
    """What a noisy line cost.

    Parameters
    ----------
    octets, packets, errors : :class:`int`
        What was sent, and the bits that were turned over.
    hit : :class:`int`
        Packets of which a bit was turned over; delimiters belong to their packet, idle time to
        the packet that comes next.
    lost : :class:`int`
        Packets that did not arrive.
    bystanders : :class:`int`
        Those among them that were not hit.
    wrong : :class:`int`
        Packets that were accepted though nobody sent them, or out of their order.
    recovered : :class:`bool`
        What was sent at the end, without errors, arrived.
    """

    octets: int
    packets: int
    errors: int
    hit: int
    lost: int
    bystanders: int
    wrong: int
    recovered: bool


def _characters(octets, starts):
    """Levels of the line, 8N1, with the idle time between packets; and each octet's first bit."""
    bits = np.ones((len(octets), 10), np.uint8)
    bits[:, 0] = 0
    bits[:, 1:9] = np.unpackbits(
        np.frombuffer(octets, np.uint8)[:, None], axis=1, bitorder="little")
    place = 10 * np.arange(len(octets))
    place += 10 * GAP_CHARACTERS * np.searchsorted(starts, np.arange(len(octets)), side="right")
    line = np.ones(place[-1] + 10 * (1 + GAP_CHARACTERS), np.uint8)
    line[place[:, None] + np.arange(10)] = bits
    return line, place


def _received(line):
    """Octets that a receiver makes of the levels; it drops those without a stop bit."""
    levels = line.tobytes()
    octets, place, limit = bytearray(), 0, len(levels) - 10
    while 0 <= (place := levels.find(0, place)) <= limit:
        word = levels[place + 1:place + 9]
        if levels[place + 9]:
            octets.append(sum(bit << shift for shift, bit in enumerate(word)))
            place += 10
        else:  # the line has to be idle before the next start bit
            place = levels.find(1, place + 9)
            if place < 0:
                break
    return bytes(octets)


def measure(octets, rate, seed, characters=False):
    """Send so many octets over a line with errors, and count what arrives.

    Parameters
    ----------
    octets : :class:`int`
        At least so many are sent.
    rate : :class:`float`
        Probability that a bit is turned over.
    seed : :class:`int`
        Of packets and errors.
    characters : :class:`bool`
        Turn over bits of the line, start, stop and idle ones among them, instead of those of the
        octets.
    """
    rng, wire = random.Random(seed), Wire()
    contents, packets, total = [], [], 0
    while total < octets:
        for piece in stream(rng, 100)[1]:
            for packet in piece:
                content, = Deframer().feed(packet)
                # The packet's number goes on from stream to stream.
                contents.append(bytes([content[0], wire.sequence]) + content[2:])
                packets.append(wire.packet(content[0], content[2:]))
                total += len(packets[-1])
    sent = b"".join(packets)
    bounds = np.cumsum([0] + [len(packet) for packet in packets])
    noise = np.random.default_rng([seed, round(1 / rate)])
    if characters:
        line, place = _characters(sent, bounds[1:-1])
        flips = noise.random(len(line)) < rate
        flips[place[-1] + 10:] = False
        received = _received(line ^ flips)
        ends = place[bounds[1:] - 1] + 10
    else:
        flips = noise.random(8 * len(sent)) < rate
        received = (np.frombuffer(sent, np.uint8) ^ np.packbits(flips)).tobytes()
        ends = 8 * bounds[1:]
    errors = np.flatnonzero(flips)
    hit = set(np.searchsorted(ends, errors, side="right").tolist())
    missing, wrong = _compare(contents, Deframer().feed(received))
    decoder = Decoder()
    decoder.events(received)
    recovered = len(decoder.events(wire.texture_frame(3))) > 0
    return Figures(len(sent), len(contents), len(errors), len(hit), len(missing),
                   len(missing - hit), wrong, recovered)


def _compare(sent, arrived):
    """Places of those that are missing, and how many arrived that were not sent there."""
    missing, wrong, place = set(), 0, 0
    left = {}
    for at, content in enumerate(sent):
        left.setdefault(content, []).append(at)
    for content in arrived:
        later = [at for at in left.get(content, ()) if at >= place]
        if not later:
            wrong += 1
            continue
        missing.update(range(place, later[0]))
        place = later[0] + 1
    missing.update(range(place, len(sent)))
    return missing, wrong
