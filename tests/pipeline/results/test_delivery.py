import json
import os
import threading

import pytest

from pipeline.results.delivery import RECORD, check_delivery, deliver
from schemas.errors import InputError
from schemas.seal import BLANK, sealed

ROBOT = {"robot.urdf": b"meshes/part_1.stl", "meshes/part_1.stl": b"1", "meshes/part_11.stl": b"1"}


def names(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}


def test_what_was_delivered_is_whole_until_a_file_is_changed_or_gone(tmp_path):
    deliver(tmp_path, {"model.json": b"{}", "report.html": b"<p>"})
    assert check_delivery(tmp_path) == []
    (tmp_path / "report.html").write_bytes(b"<q>")
    (tmp_path / "model.json").unlink()
    assert check_delivery(tmp_path) == [
        "model.json: missing",
        "report.html: its bytes were changed (its digest differs)",
    ]


def instead_of_writing(monkeypatch, act):
    for module in ("pipeline.results.delivery", "pipeline.store.files"):
        monkeypatch.setattr(f"{module}.write_atomically", act)


def test_the_model_comes_last_after_the_record_and_both_of_its_files_together(tmp_path, monkeypatch):
    written = []
    instead_of_writing(monkeypatch, lambda path, content: written.append(path.name))
    deliver(tmp_path, {"model.json": b"", "model.npz": b"", "meshes/a.stl": b"", "meshes/b.stl": b""})
    assert written == ["b.stl", "a.stl", RECORD, "model.npz", "model.json"]


def test_two_deliveries_into_one_folder_do_not_mix(tmp_path):
    models = [{"model.json": word, "model.npz": word, "report.html": word} for word in (b"a", b"b")]

    def repeat(model):
        for _ in range(30):
            deliver(tmp_path, model)

    threads = [threading.Thread(target=repeat, args=(model,)) for model in models]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert check_delivery(tmp_path) == []
    assert len({(tmp_path / name).read_bytes() for name in models[0]}) == 1


def test_a_folder_or_pipe_in_a_files_place_is_told_and_not_read(tmp_path):
    deliver(tmp_path, {"model.json": b"{}", "report.html": b""})
    (tmp_path / "report.html").unlink()
    os.mkfifo(tmp_path / "report.html")
    assert check_delivery(tmp_path) == ["report.html: missing"]
    (tmp_path / "model.json").unlink()
    (tmp_path / "model.json").mkdir()
    with pytest.raises(InputError, match="found a folder"):
        deliver(tmp_path, {"model.json": b"{}"})


def test_a_delivery_adds_to_what_another_command_delivered(tmp_path):
    deliver(tmp_path, {"model.json": b"{}"})
    deliver(tmp_path, ROBOT)
    assert set(json.loads((tmp_path / RECORD).read_text())["files"]) == {"model.json", *ROBOT}


def test_meshes_of_an_earlier_delivery_go_but_for_those_that_a_description_still_names(tmp_path):
    deliver(tmp_path, ROBOT)
    (tmp_path / "meshes" / "part_5.stl").write_bytes(b"of the user's")
    deliver(tmp_path, {"robot.xml": b"meshes/part_2.stl", "meshes/part_2.stl": b"2"})
    kept = {RECORD, "robot.urdf", "robot.xml", "meshes/part_1.stl", "meshes/part_2.stl", "meshes/part_5.stl"}
    assert names(tmp_path) == kept
    deliver(tmp_path, {"robot.urdf": b"meshes/part_2.stl"})
    assert names(tmp_path) == kept - {"meshes/part_1.stl"}
    assert check_delivery(tmp_path) == []


def test_what_was_changed_since_or_is_a_link_now_stays(tmp_path):
    deliver(tmp_path, ROBOT | {"metrics.json": b"{}"})
    (tmp_path / "precious").write_bytes(b"1")
    (tmp_path / "meshes" / "part_1.stl").write_bytes(b"changed")
    (tmp_path / "meshes" / "part_11.stl").unlink()
    (tmp_path / "meshes" / "part_11.stl").symlink_to(tmp_path / "precious")
    deliver(tmp_path, {"robot.urdf": b"nothing"}, obsolete=["metrics.json"])
    assert names(tmp_path) == {RECORD, "robot.urdf", "precious", "meshes/part_1.stl", "meshes/part_11.stl"}
    assert check_delivery(tmp_path) == []


def test_a_link_to_a_folder_of_meshes_is_not_followed(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "meshes").symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="meshes: found a symbolic link"):
        deliver(tmp_path / "out", ROBOT)
    assert names(tmp_path / "mine") == set()


@pytest.mark.parametrize("name", ["/abs/victim", "../victim", "meshes/../../victim", "..", ".", "", "deep/er/victim"])
def test_a_planted_record_removes_nothing_outside(tmp_path, name):
    victim, folder = tmp_path / "victim", tmp_path / "out"
    folder.mkdir()
    victim.write_bytes(b"x")
    digest = "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"  # of "x"
    record = {"format": "rearticulate/delivery", "version": 1, "json_sha256": BLANK, "files": {name: digest}}
    (folder / RECORD).write_bytes(sealed(json.dumps(record).encode()))
    with pytest.raises(InputError, match="found the name"):
        check_delivery(folder)
    with pytest.raises(InputError, match="found the name"):
        deliver(folder, {"robot.urdf": b""}, obsolete=[name])
    assert victim.exists()


def test_every_flipped_byte_of_the_record_is_noticed(tmp_path):
    deliver(tmp_path, {"model.json": b"{}"})
    content = (tmp_path / RECORD).read_bytes()
    for position in range(len(content)):
        flipped = bytearray(content)
        flipped[position] ^= 0x20
        (tmp_path / RECORD).write_bytes(flipped)
        with pytest.raises(InputError, match=RECORD):
            check_delivery(tmp_path)
    with pytest.raises(InputError, match="remove it"):  # and no delivery hides the damage by a new one
        deliver(tmp_path, {"robot.urdf": b""})


def test_without_a_record_nothing_is_told(tmp_path):
    with pytest.raises(InputError, match=r"delivered\.json: cannot be read \(No such file"):
        check_delivery(tmp_path)


def test_a_disk_that_is_full_leaves_the_earlier_delivery_usable(tmp_path, monkeypatch):
    deliver(tmp_path, {"model.json": b"old", "model.npz": b"old"} | ROBOT)

    def full(path, content):
        raise OSError(28, os.strerror(28))

    instead_of_writing(monkeypatch, full)
    with pytest.raises(OSError, match="No space left"):
        deliver(tmp_path, {"model.json": b"new", "model.npz": b"new"})
    monkeypatch.undo()
    assert check_delivery(tmp_path) == []
