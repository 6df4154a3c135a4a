"""What the tests of the page share: servers in threads, simulated histories, messages."""

import asyncio
import json
import threading
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from model.bayer import channels
from scripts.host.history import History
from scripts.host.messages import Frame, TextureFrame, TexturePiece
from scripts.results.drift import DriftMonitor
from scripts.view.server import PageServer
from scripts.view.session import Session
from tb.measure.simulated import calibration_of, measured, mesh_rig

__all__ = ["NOISE_PX", "WALL_COLOUR", "ask", "history_of", "serving"]

NOISE_PX = 0.04
#: Red, green and blue of what a sensor with colour filters sees.
WALL_COLOUR = 190, 100, 60
#: Flags of a frame that was lit, with valid tables.
_LIT = 0x48


def history_of(scenes, side=11, noise_px=NOISE_PX, grey=90, moved=lambda rig: rig, bayer=None):
    """The rig, and a history with a frame of each scene and a texture that is the same in all.

    With ``bayer``, the sensor has such colour filters, and the texture is :data:`WALL_COLOUR`.
    ``moved`` gives the rig that the frames are of, from the calibrated one.
    """
    rig = mesh_rig(side)
    calibration = replace(calibration_of(rig, NOISE_PX), bayer=bayer)
    history, rng = History(calibration), np.random.default_rng(1)
    monitor = DriftMonitor(calibration)
    image = np.full((calibration.height, calibration.width), grey, np.uint8)
    if bayer is None:
        image[::16], image[:, ::16] = 160, 160
    else:
        image[:] = np.array(WALL_COLOUR, np.uint8)[channels(bayer, *image.shape)]
    for number, scene in enumerate(scenes):
        index, now = 2 * number + 10, 1000 + 40_000 * number
        if not number:
            history.take(TextureFrame(index - 1, 0, 9, now, 0, 0, 0xC0, index - 1))
            for row, pixels in enumerate(image):
                history.take(TexturePiece(index - 1, row, 0, pixels))
        points = measured(moved(rig), calibration, scene, rng, noise_px, index)
        history.take(Frame(index, grey_noise=16, flags=_LIT, index=index, timestamp_us=now,
                           ok=len(points), spots=len(points)), points,
                     drift=monitor.add(points))
    return rig, history


@contextmanager
def serving(session, host="127.0.0.1"):
    """The page of a session; gives its server."""
    ready, loop, found = threading.Event(), asyncio.new_event_loop(), []

    async def serve():
        async with PageServer(session, host) as server:
            found.append((server, asyncio.current_task()))
            ready.set()
            await asyncio.Event().wait()

    def run():
        try:
            loop.run_until_complete(serve())
        except asyncio.CancelledError:
            pass
        finally:
            ready.set()

    thread = threading.Thread(target=run)
    with session:
        thread.start()
        ready.wait()
        server, task = found[0]
        try:
            yield server
        finally:
            loop.call_soon_threadsafe(task.cancel)
            thread.join()
            loop.close()


def replay(history, path=None):
    """A session of frames that are all there."""
    return Session(history, "a recording", path)


def ask(connection, **wish):
    """The reply to a message of the page; other messages are left out."""
    connection.send(json.dumps({"id": 7, **wish}))
    while True:
        text = connection.recv(timeout=10)
        if isinstance(text, str) and (answer := json.loads(text))["type"] == "reply":
            return answer
