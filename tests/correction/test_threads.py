"""Threads process a stream in order, with a bounded number of items, and pass on errors."""

from __future__ import annotations

import threading
import time

import pytest

from ospc.recording import stream
from ospc.recording.stream import mapped


@pytest.fixture(autouse=True, params=[1, 3])
def workers(request, monkeypatch):
    monkeypatch.setattr(stream, "_WORKERS", request.param)
    return request.param


@pytest.mark.parametrize("count", [0, 1, 20])
def test_results_come_in_the_order_of_the_items(count):
    def work(number):
        time.sleep(0.001 * (number % 3))
        return number**2

    assert list(mapped(work, range(count))) == [n**2 for n in range(count)]


def test_no_more_items_are_drawn_than_may_be_in_flight(workers):
    drawn, given_back = [], 0

    def items():
        for number in range(50):
            drawn.append(number)
            assert len(drawn) - given_back <= workers + 3
            yield number

    for _ in mapped(lambda n: n, items()):
        given_back += 1
    assert given_back == 50


def test_items_are_drawn_by_one_thread():
    drawing = set()

    def items():
        for number in range(10):
            drawing.add(threading.get_ident())
            yield number

    list(mapped(lambda n: n, items()))
    assert drawing == {threading.get_ident()}


def test_an_error_in_the_work_ends_it():
    done = []

    def work(number):
        if number == 3:
            raise ValueError("three")
        done.append(number)
        return number

    with pytest.raises(ValueError, match="three"):
        list(mapped(work, range(1000)))
    assert len(done) < 20


def test_an_interruption_while_drawing_ends_it():
    def items():
        yield from range(5)
        raise KeyboardInterrupt

    results = []
    with pytest.raises(KeyboardInterrupt):
        results.extend(mapped(lambda n: n, items()))
