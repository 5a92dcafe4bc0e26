import json

from pipeline.training.batches import MakerDied


def test_a_minute_of_training_lowers_the_loss(reart, tmp_path):
    done = reart(
        *("train-flow", "--out", "training", "--preset", "smoke", "--set", "robots=[]", "--set", "validation_robots=[]")
    )
    assert done.exit_code == 0
    lines = [json.loads(line) for line in (tmp_path / "training" / "log.jsonl").read_text().splitlines()]
    first, last = [line["loss"] for line in lines if line["kind"] == "measurement"]
    assert last < first
    losses = [line["loss"] for line in lines if line["kind"] == "step"]
    assert sum(losses[-6:]) < sum(losses[:6])
    assert (tmp_path / "training" / "weights.safetensors").exists()


def test_wrong_settings_end_in_one_line(reart, tmp_path):
    (tmp_path / "my.toml").write_text("stepps = 3\n")
    for words, complaint in (
        (("--preset", "smok"), "expected one of smoke"),
        (("--config", "my.toml"), "there is no setting 'stepps'; did you mean steps"),
        (("--set", "steps=0"), "steps: found 0"),
        (("--set", "robots=['atlass']"), "robot 'atlass': not known"),
        (("--set", "robots=['spot']"), "validation_robots: found 'spot', which is trained on"),
    ):
        done = reart("train-flow", "--out", "training", *words)
        assert done.exit_code == 2
        assert complaint in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1


def test_a_damaged_checkpoint_ends_in_one_line_that_says_what_to_do(reart, tmp_path):
    (tmp_path / "training").mkdir()
    (tmp_path / "training" / "checkpoint.safetensors").write_bytes(b"junk")
    done = reart("train-flow", "--out", "training", "--preset", "smoke")
    assert done.exit_code == 2
    assert "remove training/checkpoint.safetensors to begin anew" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_killed_maker_of_pairs_ends_in_one_line(reart, monkeypatch):
    def train(*args):
        raise MakerDied("killed by SIGKILL")

    monkeypatch.setattr("pipeline.training.folder.train", train)
    done = reart("train-flow", "--out", "training", "--preset", "smoke")
    assert done.exit_code == 1
    assert "ended (killed by SIGKILL); what training holds is kept: give the same command again" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
