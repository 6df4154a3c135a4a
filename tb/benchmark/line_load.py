"""Load of the serial line: octets of a frame's points, and the time to refresh a texture."""

import tempfile

import numpy as np

__all__ = ["BAUD", "PAIR_S", "octets_per_pair", "points_octets", "realistic_frames",
           "refresh_seconds"]

BAUD = 115_200
#: Time of a pattern frame and a texture frame.
PAIR_S = 0.040
_BITS = 10  # of an octet on the line
_KINDS = ("plane", "tilted", "polyp", "tube")


def octets_per_pair(baud=BAUD, pair_s=PAIR_S):
    """Octets that the line transmits in the time of a pair."""
    return baud / _BITS * pair_s


def realistic_frames(seeds, rig="endoscope", frames=4):
    """Pattern frames of simulated scenes, as the golden model measures them.

    Every seed has its own capture, with its own errors, and its own calibration.

    Returns
    -------
    list of :class:`model.link.points.PatternFrame`
    """
    from calibration.calibrate import Options, calibrate
    from calibration.capture import read_capture
    from model.link.points import PatternFrame
    from model.optics import capture, render, scenes
    from model.optics.rigs import RIGS
    from scripts.simulation.engine import open_engine

    found = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            capture.write(folder, "plane", RIGS[rig], seed, frames=1)
            calibration = calibrate(read_capture(folder), Options()).calibration
        rng = np.random.default_rng([seed, 99])
        for kind in _KINDS:
            images = [render.pattern_frame(RIGS[rig], scene, rng)[0]
                      for scene in scenes.sequence(kind, RIGS[rig], frames, rng)]
            for frame in open_engine("model", calibration).frames(images, independent=True):
                found.append(PatternFrame(
                    points=frame.points, number=len(found), level=frame.level,
                    grey_noise=frame.grey_noise, saturated=frame.saturated, laser=True,
                    tables_valid=True, spots=frame.spots, rejected=frame.rejected))
    return found


def points_octets(frame):
    """Octet times of a frame's ok points and its trailer, gaps included."""
    from model.link.framer import wire_octets
    from model.link.points import UNMATCHED, packets

    return wire_octets([content for content in packets(frame) if content[0] != UNMATCHED])


def refresh_seconds(image, frame=None, baud=BAUD, pair_s=PAIR_S, bound=2, mosaic=False):
    """Times until a coarse texture, of every eighth row, and the whole of it have been sent.

    The packets of ``frame`` (None: none, not even a trailer) are queued a third of the way through
    each pair, when its pattern has been read, and a texture frame is offered at nine tenths, when
    that has been read. Points have priority; a packet that is being sent is finished first.

    Parameters
    ----------
    image : array (height, width) of uint8
        What all texture frames show; with ``mosaic``, through colour filters.
    frame : :class:`model.link.points.PatternFrame`, optional
        The pattern frame of every pair.
    baud : :class:`int`
        Bit rate of the line.
    pair_s : :class:`float`
        Time of a pair.
    bound : :class:`int`
        Value of the register ``texture_bound``.

    Returns
    -------
    tuple of two :class:`float`
        Seconds from the end of the first texture frame on.
    """
    from model.link.framer import wire_octets
    from model.link.points import packets
    from model.link.texture import TEXTURE, Texture, TextureFrame
    from scripts.host.texture_packet import unpack

    texture = Texture(image.shape[1], image.shape[0])
    sent = np.zeros(image.shape, bool)
    coarse = None
    of_frame = [] if frame is None else packets(frame)
    queue, time, next_points, next_texture, begun = [], 0.0, pair_s / 3, 0.9 * pair_s, None
    while True:
        if time >= next_points:
            queue += of_frame
            next_points += pair_s
        if time >= next_texture:
            if texture.takes():
                texture.frame(image, TextureFrame(), bound, mosaic)
            next_texture += pair_s
            begun = time if begun is None else begun
        content = queue.pop(0) if queue else texture.packet()
        if content is None:
            time = min(next_points, next_texture)
            continue
        time += wire_octets([content]) * _BITS / baud
        if content[0] == TEXTURE:
            for row, column, grey in unpack(content[1:]):
                sent[row, column:column + len(grey)] = True
            if coarse is None and sent[::8].all():
                coarse = time - begun
            if sent.all():
                return coarse, time - begun
