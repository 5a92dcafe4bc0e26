import os
import threading

import pytest

from pipeline.store.files import PARTIAL, open_fresh, read_whole, write_atomically, write_files


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_new_content_takes_the_place_of_the_old(tmp_path):
    for content in (b"old", b"new"):
        write_atomically(tmp_path / "a", content)
        assert (tmp_path / "a").read_bytes() == content
    assert names(tmp_path) == ["a"]


def test_many_writers_of_one_path_neither_collide_nor_tear_it(tmp_path):
    contents = [bytes([number]) * 10_000 for number in range(4)]
    errors, torn = [], []

    def write(content):
        for _ in range(50):
            try:
                write_atomically(tmp_path / "a", content)
                torn.append((tmp_path / "a").read_bytes() not in contents)
            except OSError as error:
                errors.append(error)

    threads = [threading.Thread(target=write, args=(content,)) for content in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (errors, sum(torn), names(tmp_path)) == ([], 0, ["a"])


def test_a_link_at_the_target_is_replaced_and_what_it_leads_to_stays(tmp_path):
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "a").symlink_to("victim")
    write_atomically(tmp_path / "a", b"new")
    assert (tmp_path / "victim").read_text() == "mine"
    assert not (tmp_path / "a").is_symlink()


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_atomically(tmp_path / "folder", b"new")
    assert names(tmp_path) == ["folder"]
    with pytest.raises(FileNotFoundError):
        write_atomically(tmp_path / "nowhere" / "a", b"new")


def test_what_a_killed_writer_left_goes_and_what_a_living_one_writes_stays(tmp_path, monkeypatch):
    (tmp_path / f".killed{PARTIAL}").write_text("half")
    seen = []
    rename = os.replace

    def meanwhile(partial, path):
        monkeypatch.setattr(os, "replace", rename)
        write_atomically(tmp_path / "other", b"")
        seen.extend(names(tmp_path))
        rename(partial, path)

    monkeypatch.setattr(os, "replace", meanwhile)
    write_atomically(tmp_path / "a", b"new")
    assert seen[0].endswith(PARTIAL)
    assert seen[0] != f".killed{PARTIAL}"
    assert names(tmp_path) == ["a", "other"]


def test_a_log_follows_no_link_and_leaves_another_writers_file_alone(tmp_path):
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "log").symlink_to("victim")
    with open_fresh(tmp_path / "log") as first, open_fresh(tmp_path / "log") as second:
        first.write("first\n")
        second.write("second\udcff\n")
    assert (tmp_path / "victim").read_text() == "mine"
    assert (tmp_path / "log").read_text() == "second\\udcff\n"


def test_a_folder_at_a_logs_path_is_told(tmp_path):
    (tmp_path / "log").mkdir()
    with pytest.raises(OSError, match="log"):
        open_fresh(tmp_path / "log")


def test_the_first_file_is_written_last(tmp_path, monkeypatch):
    written = []
    monkeypatch.setattr("pipeline.store.files.write_atomically", lambda path, content: written.append(path.name))
    write_files(tmp_path, {"robot.urdf": b"", "meshes/a.stl": b"", "meshes/b.stl": b""})
    assert written[-1] == "robot.urdf"
    assert (tmp_path / "meshes").is_dir()


def test_a_file_that_is_huge_or_never_ends_is_not_read(tmp_path):
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(2**31)
    os.mkfifo(tmp_path / "pipe")
    for name, said in (("huge", "2048 MiB"), ("pipe", "no regular file")):
        with pytest.raises(OSError, match=said):
            read_whole(tmp_path / name)
