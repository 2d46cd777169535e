# SPDX-License-Identifier: GPL-3.0-or-later

"""Map tiles from the disk: what is a tile, what is refused, and that nothing outside of the folder is read."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

import pytest

from gcs_module.watch.tiles import MOST_BYTES, TilesError, open_tiles, place_of

PNG = b"\x89PNG\r\n\x1a\n" + b"picture"
JPEG = b"\xff\xd8\xff\xe0" + b"picture"


def folder(root: Path, *tiles: str, data: bytes = PNG) -> Path:
    for name in tiles:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return root


def mbtiles(path: Path, tiles: dict[tuple[int, int, int], bytes], **metadata: str) -> Path:
    made = sqlite3.connect(path)
    made.execute("CREATE TABLE metadata (name text, value text)")
    made.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
    made.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
    made.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", [(*place, data) for place, data in tiles.items()])
    made.commit()
    made.close()
    return path


@pytest.mark.parametrize("ending", [".png", ".jpg", ".webp"])
def test_a_folder_gives_its_tiles(tmp_path: Path, ending: str) -> None:
    tiles = open_tiles(folder(tmp_path / "map", f"3/1/2{ending}", f"5/0/0{ending}"), "us")
    found = tiles.read(3, 1, 2)
    assert found is not None
    assert (found.data, found.kind) == (PNG, "image/png")
    assert tiles.read(3, 2, 1) is None
    assert tiles.drawn() == {"url": "/tiles/{z}/{x}/{y}", "credit": "us", "low": 3, "high": 5}


def test_a_folder_that_counts_from_the_south_is_turned(tmp_path: Path) -> None:
    root = folder(tmp_path, "3/1/2.png")
    (root / "tilemapresource.xml").write_text("<TileMap/>")
    tiles = open_tiles(root)
    assert tiles.read(3, 1, 2) is None
    assert tiles.read(3, 1, 5) is not None


def test_an_mbtiles_file_gives_its_tiles_counted_from_the_north(tmp_path: Path) -> None:
    path = mbtiles(
        tmp_path / "a b#?.mbtiles",
        {(3, 1, 5): JPEG, (4, 0, 0): PNG},
        bounds="5.0,52.0,6.0,53.0",
        attribution='<a href="x" onclick="evil()">Land & Co</a>',
    )
    tiles = open_tiles(path)
    found = tiles.read(3, 1, 2)
    assert found is not None
    assert (found.data, found.kind) == (JPEG, "image/jpeg")
    assert tiles.read(3, 1, 5) is None
    assert tiles.drawn() == {
        "url": "/tiles/{z}/{x}/{y}",
        "credit": "Land &amp; Co",
        "low": 3,
        "high": 4,
        "bounds": [[52.0, 5.0], [53.0, 6.0]],
    }


@pytest.mark.parametrize("bounds", ["", "1,2,3", "9,52,6,53", "nan,0,1,1", "a,b,c,d", "5,52,6,153"])
def test_bounds_that_are_none_are_left_out(tmp_path: Path, bounds: str) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(3, 1, 5): PNG}, bounds=bounds)
    assert "bounds" not in open_tiles(path).drawn()


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("0/0/0", (0, 0, 0)),
        ("3/7/7", (3, 7, 7)),
        ("3/8/0", None),
        ("3/0/8", None),
        ("25/0/0", None),
        ("-1/0/0", None),
        ("3/1", None),
        ("3/1/2.png", None),
        ("../../etc/passwd", None),
        ("3/../1/2", None),
        ("3/1/2/", None),
        ("3/1/999999999", None),
        ("٣/1/2", None),
        ("3/1/2\n", None),
        ("", None),
    ],
)
def test_a_place_is_three_whole_numbers(text: str, place: tuple[int, int, int] | None) -> None:
    assert place_of(text) == place


def test_what_is_no_picture_or_too_large_is_as_if_it_were_missing(tmp_path: Path) -> None:
    large = PNG.ljust(MOST_BYTES + 1, b"x")
    for name, data in (("3/0/0.png", PNG), ("3/0/1.png", b"<svg onload=evil()>"), ("3/0/2.png", large)):
        folder(tmp_path / "map", name, data=data)
    (tmp_path / "map/3/0/3.png").mkdir()
    os.mkfifo(tmp_path / "map/3/0/4.png")
    held = mbtiles(tmp_path / "m.mbtiles", {(3, 0, 7): PNG, (3, 0, 6): b"<svg>", (3, 0, 5): large})
    for tiles in (open_tiles(tmp_path / "map"), open_tiles(held)):
        assert [tiles.read(3, 0, row) is not None for row in range(6)] == [True, False, False, False, False, False]


def test_a_link_that_leads_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(PNG)
    root = folder(tmp_path / "map", "3/0/0.png")
    (root / "3/0/1.png").symlink_to(tmp_path / "secret")
    (root / "3/0/2.png").symlink_to(root / "3/0/0.png")
    (root / "3/0/3.png").symlink_to("3.png")
    tiles = open_tiles(root)
    assert [tiles.read(3, 0, row) is not None for row in range(4)] == [True, False, True, False]


def test_an_mbtiles_file_is_only_read(tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(3, 1, 5): PNG})
    before = path.read_bytes()
    path.chmod(0o400)
    assert open_tiles(path).read(3, 1, 2) is not None
    assert path.read_bytes() == before
    assert sorted(each.name for each in tmp_path.iterdir()) == ["m.mbtiles"]


SLOW = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT count(*) FROM n"


def with_view(path: Path, view: str) -> Path:
    """An MBTiles file whose tiles are made by a view."""
    mbtiles(path, {(3, 1, 5): PNG, (3, 1, 7): PNG})
    made = sqlite3.connect(path)
    made.execute("ALTER TABLE tiles RENAME TO pictures")
    made.execute(f"CREATE VIEW tiles AS {view}")
    made.commit()
    made.close()
    return path


def test_a_view_that_never_ends_gives_no_tile_and_holds_nothing(tmp_path: Path) -> None:
    data = f"CASE WHEN tile_row = 7 THEN ({SLOW}) ELSE tile_data END AS tile_data"
    view = f"SELECT zoom_level, tile_column, tile_row, {data} FROM pictures"
    tiles = open_tiles(with_view(tmp_path / "m.mbtiles", view))
    assert tiles.read(3, 1, 0) is None
    assert tiles.read(3, 1, 2) is not None, "the lock is free again"


def test_a_file_whose_list_never_ends_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_module.watch.tiles._OPEN_S", 0.5)
    view = f"SELECT ({SLOW}) AS zoom_level, 1 AS tile_column, 1 AS tile_row, x'' AS tile_data"
    with pytest.raises(TilesError, match="is no MBTiles file"):
        open_tiles(with_view(tmp_path / "m.mbtiles", view))


def test_a_file_that_gets_damaged_gives_no_tile_and_no_fault(tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(3, 1, row): PNG.ljust(3000, b"x") for row in range(8)})
    tiles = open_tiles(path)
    path.write_bytes(path.read_bytes()[:8192] + bytes(20_000))
    assert all(found is None or found.data.startswith(PNG) for found in (tiles.read(3, 1, row) for row in range(8)))


def test_what_cannot_be_used_is_one_line_that_says_what_is_allowed(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no tiles")
    (tmp_path / "empty").mkdir()
    folder(tmp_path / "high", "map/3/0/0.png")
    folder(tmp_path / "bare", "3/0/0.txt")
    mbtiles(tmp_path / "none.mbtiles", {})
    mbtiles(tmp_path / "vector.mbtiles", {(3, 0, 0): b"\x1f\x8b\x08protobuf"}, format="pbf")
    mbtiles(tmp_path / "zoom.mbtiles", {(99, 0, 0): PNG})
    says = {
        "missing": "no such file or folder; allowed are an MBTiles file and a folder with z/x/y.png",
        "text": "is no MBTiles file (file is not a database); allowed are",
        "empty": "has no folders 0, 1, 2 ... for the zooms; allowed are",
        "high": "Did you mean ",
        "bare": "has no pictures in 3/x/; allowed are",
        "none.mbtiles": "has no tiles",
        "vector.mbtiles": "It says format pbf. Vector tiles cannot be shown.",
        "zoom.mbtiles": "zooms 99 to 99: must be 0 to 24",
    }
    for name, text in says.items():
        with pytest.raises(TilesError) as caught:
            open_tiles(tmp_path / name)
        told = str(caught.value)
        assert told.startswith(f"{tmp_path / name}: ")
        assert text in told
        assert "\n" not in told
