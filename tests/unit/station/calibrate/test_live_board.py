"""Live calibration: a view is taken where the board is somewhere new, until the image is covered."""

from __future__ import annotations

import numpy as np

from common.frames.ring import Image
from station.calibrate.board import Board, covered_cells
from station.calibrate.live_board import BoardCollector, collect

BOARD = Board(columns=5, rows=4, square_m=0.03)
SIZE = (360, 288)
SQUARE = 14


def board_at(left: int, top: int) -> Image:
    image = np.full((SIZE[1], SIZE[0]), 220, np.uint8)
    tile = np.kron(np.indices((BOARD.rows + 1, BOARD.columns + 1)).sum(axis=0) % 2, np.ones((SQUARE, SQUARE)))
    dark = (200 - 180 * tile).astype(np.uint8)
    image[top : top + dark.shape[0], left : left + dark.shape[1]] = dark
    return image


def everywhere() -> list[Image]:
    return [board_at(left, top) for top in (4, 70, 140, 212) for left in (4, 70, 135, 205, 270)]


def test_a_view_is_taken_when_the_board_is_somewhere_new() -> None:
    collector = BoardCollector(BOARD, SIZE)
    assert collector.take(board_at(30, 40))
    assert not collector.take(board_at(32, 41)), "hardly moved"
    assert not collector.take(np.full((SIZE[1], SIZE[0]), 220, np.uint8))
    assert not collector.found
    assert collector.take(board_at(150, 40))
    assert not collector.take(board_at(30, 40)), "been there before"
    assert len(collector.views) == 2
    assert "2 images with the whole board" in collector.missing


def test_collecting_ends_by_itself_when_the_image_is_covered() -> None:
    collector, said = BoardCollector(BOARD, SIZE), list[str]()
    images = iter([*everywhere(), board_at(30, 40), board_at(30, 40)])
    collect(images, collector, lambda: said.append(collector.missing))
    assert said[-1] == ""
    assert all(said[:-1])
    assert next(images, None) is not None, "it did not wait for more than it needs"


def test_the_grid_shows_what_is_covered() -> None:
    collector = BoardCollector(BOARD, SIZE)
    collector.take(board_at(4, 4))
    rows = collector.grid().split("\n")
    assert [len(row.split()) for row in rows] == [6] * 6
    assert rows[0].startswith("■")
    assert rows[5] == "· · · · · ·"
    assert collector.grid().count("■") == covered_cells(collector.views, SIZE).sum()
