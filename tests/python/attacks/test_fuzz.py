"""The command `fuzz`: failures are found, made smaller and kept, and a killed run goes on."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sweep_scenes

import sheetsplat as ss
from fuzz import cases
from fuzz.__main__ import Attack, main
from fuzz.book import Book
from fuzz.cases import Case
from fuzz.child import judged
from fuzz.files import SpoiledFiles
from fuzz.limits import Clock
from fuzz.mutations import mutated
from fuzz.part import Outcome, Part
from fuzz.scenes import RandomScenes
from fuzz.shrinking import fewest
from fuzz.soak import LongRuns

TESTS = Path(__file__).parents[2]
KEPT = sorted((Path(__file__).parents[1] / "fuzz_kept").glob("*.json"))
PARTS: dict[str, type[Part]] = {"files": SpoiledFiles, "scenes": RandomScenes, "soak": LongRuns}
# What a planted fault waits for, and how it shows.
MARK = b"%"
ENDS = {
    "raises": "ZeroDivisionError in test_fuzz.py, run",
    "crashes": "crash, SIGSEGV",
    "hangs": "hang",
    "waits": "waited in test_fuzz.py, run",
    "grows": "memory",
    "exits": "exit code 3",
}


# Ways of which each try takes seconds: such failures are kept as they are.
SLOW = ("hangs", "waits", "grows")


class Planted(SpoiledFiles):
    """Reads files, but ends badly where one has a certain byte."""

    batch = 10
    seconds = 1.0
    memory = 600 << 20

    def __init__(self, way: str) -> None:
        super().__init__(["csv"])
        self.way = way
        if way == "grows":
            # The pages of so much memory take a while themselves.
            self.seconds = 30.0

    def run(self, case: Case, folder: Path) -> Outcome:
        outcome = super().run(case, folder)
        if MARK in case["files"][case["spoiled"]]:
            match self.way:
                case "raises":
                    return Outcome(str(1 // 0))
                case "crashes":
                    os.kill(os.getpid(), signal.SIGSEGV)
                case "hangs":
                    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGPROF])
                    while True:
                        pass
                case "waits":
                    while True:
                        pass
                case "grows":
                    taken = bytearray(self.memory)
                    taken[:: 1 << 12] = b"x" * len(taken[:: 1 << 12])
                    time.sleep(60)
                case "exits":
                    os._exit(3)
        return outcome


def attacked(folder: Path, part: Part, *, most: int, shrinking: float = 20.0) -> dict[str, Any]:
    """Return the summary after that many cases of a part."""
    part.prepare(folder)
    book = Book(folder, [part], clock=Clock(300), most=most)
    Attack([part], book, shrinking=shrinking).run(1)
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text())[part.name]
    return found


@pytest.mark.parametrize("way", [pytest.param(way, marks=pytest.mark.slow) if way in SLOW else way for way in ENDS])
def test_a_planted_fault_is_found_made_smaller_and_kept(way: str, tmp_path: Path) -> None:
    found = attacked(tmp_path, Planted(way), most=10, shrinking=0.0 if way in SLOW else 60.0)
    (what,) = found["failures"]
    assert what == ENDS[way]
    failure = found["failures"][what]
    # The others of its batch are judged all the same.
    assert found["kinds"]["csv"]["cases"] == 10
    assert found["kinds"]["csv"]["verdicts"]["wrong"] == failure["count"] == 1
    kept = cases.load(tmp_path / "failures" / failure["files"][0])
    assert kept["what"] == what and kept["text"] or way == "exits"
    assert str(Path(__file__).parents[3]) not in "".join(kept["text"])
    spoiled = kept["case"]["files"][kept["case"]["spoiled"]]
    assert MARK in spoiled
    if way not in SLOW:
        assert spoiled == MARK


def test_a_reader_without_faults_passes(tmp_path: Path) -> None:
    found = attacked(tmp_path, SpoiledFiles(["nrrd"]), most=100)
    assert found["failures"] == {} and sum(found["kinds"]["nrrd"]["verdicts"].values()) == 100
    assert found["kinds"]["nrrd"]["verdicts"]["InvalidInput"] > 20


class Denser(RandomScenes):
    """Scenes whose opacities the processor has a thousandth too high."""

    batch = 4
    kinds = {"cpu": 1.0}

    def run(self, case: Case, folder: Path) -> Outcome:
        draw = sweep_scenes.draw

        def denser(parts: Any, backend: str, outputs: Any) -> ss.Image:
            if backend == "cpu" and parts.get("groups") is None:
                parts = parts | {"transfer": [(*point[:4], 1.001 * point[4]) for point in parts["transfer"]]}
            return draw(parts, backend, outputs)

        sweep_scenes.draw = denser
        try:
            return super().run(case, folder)
        finally:
            sweep_scenes.draw = draw


@pytest.mark.slow
def test_a_wrong_scene_is_found_made_smaller_and_kept(tmp_path: Path) -> None:
    found = attacked(tmp_path, Denser(), most=16, shrinking=5.0)
    files = [file for failure in found["failures"].values() for file in failure["files"]]
    smaller = 0
    for file in files:
        kept = cases.load(tmp_path / "failures" / file)
        whole, less = RandomScenes().case("cpu", kept["seed"])["parts"], kept["case"]["parts"]
        smaller += bool(np.prod(less["size"]) < np.prod(whole["size"]) or len(less["scene"]) < len(whole["scene"]))
    # (Some are small as they are drawn.)
    assert smaller > 0
    place = tmp_path / "again"
    place.mkdir()
    assert judged(Denser(), kept["case"], place).is_wrong
    assert not judged(RandomScenes(), kept["case"], place).is_wrong


class Leaking(LongRuns):
    """Frames of which one scene is never forgotten."""

    batch = 1
    kinds = {"frames": 1.0}
    kept: list[bytes] = []

    def case(self, kind: str, seed: int) -> Case:
        return super().case(kind, seed) | {"numbers": [1, 2, 3, 4]}

    def run(self, case: Case, folder: Path) -> Outcome:
        draw = sweep_scenes.scene_of

        def leaking(number: int) -> Any:
            if number == 3:
                self.kept.append(os.urandom(4 << 20))
            return draw(number)

        sweep_scenes.scene_of = leaking
        try:
            return super().run(case, folder)
        finally:
            sweep_scenes.scene_of = draw


@pytest.mark.slow
def test_memory_that_grows_is_found(tmp_path: Path) -> None:
    found = attacked(tmp_path, Leaking(), most=1)
    assert list(found["failures"]) == ["cpu: memory grows"]
    (file,) = found["failures"]["cpu: memory grows"]["files"]
    assert cases.load(tmp_path / "failures" / file)["case"]["numbers"] == [3]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["frames", "viewer", "bricks", pytest.param("gl", marks=pytest.mark.gl)])
def test_long_runs_pass(kind: str, tmp_path: Path) -> None:
    if kind == "bricks":
        pytest.importorskip("distributed", reason="no distributed: pip install 'sheetsplat[distributed]'")
    part = LongRuns()
    part.kinds = {kind: 1.0}
    part.batch = 1
    found = attacked(tmp_path, part, most=1)
    assert found["failures"] == {} and found["kinds"][kind]["verdicts"] == {"right": 1}


def command(folder: Path, *options: str) -> list[str]:
    """Return the command line of a run."""
    files = ["--kind", "csv", "--kind", "nrrd", "--kind", "vti text", "--jobs", "2", "--output", str(folder)]
    return [sys.executable, "-m", "fuzz", "files", *files, *options]


def counts(folder: Path) -> dict[str, Any]:
    """Return what a summary counts; times differ from run to run."""
    entry = json.loads((folder / "summary.json").read_text())["files"]
    return {name: {**kind, "seconds": 0} for name, kind in entry["kinds"].items()} | {"begun": entry["begun"]}


@pytest.mark.slow
def test_a_killed_run_goes_on(tmp_path: Path) -> None:
    """Killed and stopped runs count each case once, as one run does."""
    environment = {**os.environ, "PYTHONPATH": str(TESTS)}
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    subprocess.run(command(whole, "--cases", "1600"), env=environment, check=True, stdout=subprocess.DEVNULL)
    for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
        run = subprocess.Popen(command(parts, "--cases", "1600"), env=environment, stdout=subprocess.DEVNULL)
        try:
            before = counts(parts) if (parts / "summary.json").exists() else None
            end = time.monotonic() + 60
            while time.monotonic() < end and run.poll() is None:
                if (parts / "summary.json").exists() and counts(parts) != before:
                    break
                time.sleep(0.02)
        finally:
            run.send_signal(number)
            run.wait(60)
        assert counts(parts) != counts(whole)
    subprocess.run(command(parts, "--cases", "1600"), env=environment, check=True, stdout=subprocess.DEVNULL)
    assert counts(parts) == counts(whole)
    assert counts(whole)["begun"] == [] and sum(one["cases"] for one in list(counts(whole).values())[:3]) == 1600


def test_the_clock_leaves_out_what_a_process_was_stopped() -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", "import time; from fuzz.limits import Clock; c = Clock(9); print(flush=True); "
         "input(); time.sleep(0.6); print(c.is_over(), flush=True)"],
        env={**os.environ, "PYTHONPATH": str(TESTS)}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert child.stdout is not None
        child.stdout.readline()
        child.send_signal(signal.SIGSTOP)
        time.sleep(3.0)
        child.send_signal(signal.SIGCONT)
        assert child.communicate("\n", timeout=30)[0] == "False\n"
    finally:
        child.kill()


def test_cases_come_back_from_json(tmp_path: Path) -> None:
    case = {
        "bytes": bytes(range(256)),
        "tuple": (1, (2.5, "a")),
        "list": [None, True, {"x": [b""]}],
        "array": np.array([[0.1, np.nan], [np.inf, 5e-324]], ">f8"),
        "small": np.arange(3, dtype=np.float32),
        "none": np.zeros((2, 0)),
        "rows": [(0.1, -0.0), (1e-320, 2.0)],
        "number": np.float64(0.1),
    }
    cases.save(tmp_path / "a.json", case)
    found = cases.load(tmp_path / "a.json")
    for name in ("array", "small", "none"):
        assert found[name].dtype == case[name].dtype and found[name].shape == case[name].shape
        assert found.pop(name).tobytes() == case.pop(name).tobytes()
    assert found == case and isinstance(found["tuple"][1], tuple)


@pytest.mark.parametrize("wanted", [(3,), (3, 90), (0, 1, 2, 99), tuple(range(40, 60))])
def test_fewest_items_that_fail(wanted: tuple[int, ...]) -> None:
    tries = 0

    def wrong(items: list[int]) -> bool:
        nonlocal tries
        tries += 1
        return set(wanted) <= set(items)

    assert fewest(list(range(100)), wrong) == list(wanted)
    assert tries < 400


def test_mutations_are_of_all_kinds_and_come_back_by_their_seed() -> None:
    content = b"sizes: 12 13 14 " + bytes(60)
    data = b"HEAD 3 4\n" + zlib.compress(content) + b"END"
    made = [mutated(random.Random(seed), data, [b"OTHERFILE" * 9]) for seed in range(3000)]
    assert made == [mutated(random.Random(seed), data, [b"OTHERFILE" * 9]) for seed in range(3000)]
    assert sum(one == data for one in made) < 300 and any(b"OTHER" in one for one in made)
    inner = []
    for one in made:
        if one[:11] == data[:11] and one.endswith(b"END"):
            try:
                inner.append(zlib.decompress(one[9:-3]))
            except zlib.error:
                continue
    assert sum(one != content for one in inner) > 50


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_what_was_found_and_mended_stays_so(path: Path, tmp_path: Path) -> None:
    kept = cases.load(path)
    for change in ({}, *kept.get("also", ())):
        outcome = judged(PARTS[kept["part"]](), kept["case"] | change, tmp_path)
        assert not outcome.is_wrong, f"{kept['why']}\n{outcome.what}\n{outcome.text}"


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_kept_failures_say_what_they_guard_and_name_no_folder(path: Path) -> None:
    kept = cases.load(path)
    assert kept["why"].endswith(".") and str(kept["seed"]) not in path.stem
    assert not [line for line in kept["text"] if 'File "/' in line]


@pytest.mark.parametrize("words", [["--kind", "foo"], ["foo"], ["--minutes", "-1"], ["--again", "no.json"]])
def test_words_that_the_command_does_not_know(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(words)
    assert words[-1] in capsys.readouterr().err


def test_the_command_judges_a_kept_failure_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = SpoiledFiles(["csv"])
    part.prepare(tmp_path)
    cases.save(tmp_path / "a.json", {"part": "files", "case": part.case("csv", 1)})
    assert main(["--again", str(tmp_path / "a.json")]) == 0
    assert capsys.readouterr().out.strip() in ("right", "InvalidInput")
    assert main(["--list"]) == 0 and "ome-zarr" in capsys.readouterr().out
