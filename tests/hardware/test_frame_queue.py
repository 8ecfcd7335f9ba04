"""The queue before the estimator drops the oldest frames, counted, and never blocks who puts."""

import threading

import numpy as np

from softfuse.hardware.live.pipeline import Assembled
from softfuse.hardware.live.session import FrameQueue


def frame(k: int) -> Assembled:
    return Assembled(float(k), np.array([float(k)]), float(k))


def test_all_that_waits_is_taken_in_order() -> None:
    frames = FrameQueue(10)
    for k in range(5):
        frames.put(k, frame(k))
    assert frames.waiting == 5
    assert [number for number, _ in frames.take()] == [0, 1, 2, 3, 4] and frames.waiting == 0


def test_the_oldest_go_and_are_counted() -> None:
    frames = FrameQueue(3)
    for k in range(10):
        frames.put(k, frame(k))
    assert frames.dropped == 7
    assert [number for number, _ in frames.take()] == [7, 8, 9]


def test_taking_waits_for_a_frame_and_ends_with_none() -> None:
    frames, taken = FrameQueue(3), []

    def run() -> None:
        while batch := frames.take():
            taken.extend(number for number, _ in batch)

    thread = threading.Thread(target=run)
    thread.start()
    for k in range(3):
        frames.put(k, frame(k))
    frames.close()
    thread.join(10.0)
    assert not thread.is_alive() and taken == [0, 1, 2] and frames.take() == []
