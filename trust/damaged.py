"""Saved plans and unfinished runs by the thousand, damaged or made to do harm.

    python -m trust.damaged --count 10000 --seed 1 --json out/damaged.json

Each must be refused as an `InputError` that names the file, in a second and with little memory, or
be what it honestly is: a plan that says it is solved is judged by a second rod code. Nothing else
in the folder, nor beside it, may change.
"""

from __future__ import annotations

import argparse
import copy
import faulthandler
import io
import json
import os
import random
import resource
import sys
import tempfile
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from trunk_ocp.errors import InputError
from trunk_ocp.planning.checkpoint import Checkpoint
from trunk_ocp.planning.labeled import dataset
from trunk_ocp.planning.plan import Plan
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import Motion

from .answers import wrongs
from .mutations import HOSTILE, places

SECONDS = 1.0
"""Of processor time that reading a file may take."""
MEGABYTES = 300.0
"""By which the memory of the process may grow, over all files."""
PATIENCE = 600
"""Seconds after which a case counts as one without end, and the run stops with a traceback."""

PROBLEM = """
name = "saved"
bounds = { activation = [-3.0, 0.0], extension = [0.67, 1.35] }
[[phases]]
name = "reach"
duration = 1.0
steps = 2
auxiliary = { activation_deviation = 0.4 }
change = [{ activation = 0.5 }]
[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]
"""


@dataclass(frozen=True)
class Originals:
    """A motion, its plan, the arrays and the bytes of that, and the bytes of an unfinished run."""

    motion: Motion
    plan: Plan
    arrays: Any
    solution: bytes
    resume: bytes


class _Once(Checkpoint):
    """Keeps what the first window has decided, and nothing after it."""

    def save(self, *arguments: Any, **options: Any) -> None:
        if not self.path.exists():
            super().save(*arguments, **options)


@cache
def originals() -> Originals:
    """Whole files of which damaged ones are made."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "saved.toml").write_text(PROBLEM)
        motion = load_motion(folder / "saved.toml")
        plan = plan_motion(motion, 1, checkpoint=_Once(folder / "resume.npz"), throw=False)
        save_plan(plan, folder)
        return Originals(
            motion,
            plan,
            dataset(plan),
            (folder / "solution.nc").read_bytes(),
            (folder / "resume.npz").read_bytes(),
        )


# --- damage --------------------------------------------------------------------------------


def flipped(content: bytes, dice: random.Random) -> bytes:
    """Some bytes changed, half of the time near the beginning or the end."""
    result = bytearray(content)
    for _ in range(dice.choice([1, 1, 2, 8, 64])):
        near = dice.choice([dice.randrange(min(2000, len(result))), dice.randrange(len(result))])
        result[dice.choice([near, -1 - near])] = dice.randrange(256)
    return bytes(result)


def cut(content: bytes, dice: random.Random) -> bytes:
    """A part lost, doubled or moved."""
    a, b = sorted(dice.randrange(len(content)) for _ in range(2))
    return dice.choice(
        [content[:a], content[a:], content[:a] + content[b:], content[:b] + content[a:]]
    )


def renumbered(content: bytes, dice: random.Random) -> bytes:
    """A number of four bytes in the header replaced by one at the edge, up to three times."""
    result = bytearray(content)
    for _ in range(dice.randint(1, 3)):
        at = 4 * dice.randrange(1, min(5000, len(result) // 4))
        value = dice.choice([0, 1, 2, 7, 255, 2**16, 2**20, 2**30, 2**31 - 1, 2**31, 2**32 - 1])
        result[at : at + 4] = value.to_bytes(4, "big")
    return bytes(result)


def hostile(dice: random.Random) -> Any:
    """A value that has no place in a file, as JSON takes it."""
    deep: Callable[[], Any] = lambda: json.loads("[" * 300 + "]" * 300)
    value = dice.choice([v for v in HOSTILE if type(v) in (str, float, int, bool, list, dict)])
    return dice.choice([lambda: value, lambda: value, deep])()


def edited(record: Any, dice: random.Random) -> Any:
    """A record with one to three values anywhere in it changed, dropped or added."""
    record = json.loads(json.dumps(record))
    for _ in range(dice.randint(1, 3)):
        every = list(islice(places(record), 2000))  # a hostile value may have millions
        if not every:
            break
        *outer, last = dice.choice(every)
        owner = record
        for key in outer:
            owner = owner[key]
        how = dice.choice(["value", "value", "drop", "add"])
        if how == "drop":
            del owner[last]
        elif how == "add" and isinstance(owner, dict):
            owner[dice.choice(["output_file", "ipopt.output_file", "__class__", "\x1b[2J"])] = "x"
        else:
            owner[last] = copy.deepcopy(hostile(dice))  # never the same object inside itself
    return record


def text_of(record: Any, dice: random.Random) -> str:
    """JSON, or something like it."""
    texts: list[Callable[[], str]] = [
        lambda: json.dumps(edited(record, dice)),
        lambda: json.dumps(edited(record, dice)),
        lambda: json.dumps(hostile(dice)),
        lambda: "[" * 100_000,
        lambda: '{"a":' * 50_000,
        lambda: "[" + "[]," * 1_000_000 + "0]",
        lambda: "9" * 100_000,
        lambda: "\x1b[31m",
    ]
    return dice.choice(texts)()


# --- saved plans -----------------------------------------------------------------------------


def solution(dice: random.Random) -> bytes:
    """A solution.nc that is damaged or edited."""
    whole = originals().solution
    kinds: list[Callable[[], bytes]] = [
        lambda: flipped(whole, dice),
        lambda: cut(whole, dice),
        lambda: renumbered(whole, dice),
        lambda: renumbered(whole, dice),
        lambda: _netcdf(_attributes(dice)),
        lambda: _netcdf(_arrays(dice)),
    ]
    return dice.choice(kinds)()


def _netcdf(data: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solution.nc"
        data.to_netcdf(path, engine="scipy")
        return path.read_bytes()


def _attributes(dice: random.Random) -> Any:
    data = originals().arrays
    name = dice.choice(sorted(data.attrs))
    if name.endswith("_json"):
        return data.assign_attrs({name: text_of(json.loads(data.attrs[name]), dice)})
    plain = [0, 1, 2, -1, 2**31 - 1, 1e308, float("nan"), "", "x", "\x1b[31m", "[/nope]"]
    return data.assign_attrs({name: dice.choice(plain)})


def _arrays(dice: random.Random) -> Any:
    """Arrays with other numbers or another shape; or, of late, a mesh beyond reason."""
    data = originals().arrays.copy(deep=True)
    name = dice.choice(sorted(set(data.variables) - {"muscle", "angle", "axis", "director"}))
    how = dice.choice(["value", "all", "scale", "drop", "short", "near", "mesh"])
    if how == "drop":
        return data.drop_vars(name)
    if how == "short":
        dimension = dice.choice(sorted(data.sizes))
        return data.isel({dimension: slice(0, dice.randint(1, data.sizes[dimension]))})
    if how == "near":
        x = data["activation"].values + dice.uniform(-0.4, 0.4)
        return data.assign(near_activation=(data["near_activation"].dims, x))
    if how == "mesh":
        return _finer(data, dice.choice([300, 1200, 5000]))
    values = np.array(data[name].values)
    value = dice.choice([np.nan, np.inf, -1e308, 1e308, 0.0, 1e-320, 1e6, -3.0, 1.0])
    kind = values.dtype if values.dtype.kind == "f" else float
    flat = values.reshape(-1).astype(float)
    with np.errstate(all="ignore"):
        if how == "value":
            flat[dice.randrange(flat.size)] = value
        else:
            flat = flat * value if how == "scale" else np.full_like(flat, value)
        return data.assign({name: (data[name].dims, flat.reshape(values.shape).astype(kind))})


def _finer(data: Any, elements: int) -> Any:
    """The same plan on many elements; 1,200 of them are half a megabyte, and gigabytes in use."""
    edges = data["edge"].values
    inner = np.linspace(0.0, edges[-1], elements - len(edges) + 3)[1:-1] + 1e-9
    states = np.repeat(data["state"].values[:, :1], elements, axis=1)
    dropped = data.drop_vars(["edge", "state"])
    return dropped.assign(
        edge=("edge_number", np.unique(np.concatenate([edges, inner]))[: elements + 1]),
        state=(data["state"].dims, states),
    )


# --- unfinished runs ---------------------------------------------------------------------------


def unfinished(dice: random.Random) -> bytes:
    """A resume.npz that is damaged or edited."""
    whole = originals().resume
    kinds: list[Callable[[], bytes]] = [
        lambda: flipped(whole, dice),
        lambda: cut(whole, dice),
        lambda: _archive(dice, _members(dice)),
        lambda: _archive(dice, _members(dice)),
        lambda: _archive(dice, _members(dice)),
    ]
    return dice.choice(kinds)()


def _members(dice: random.Random) -> dict[str, bytes]:
    """The arrays of an archive, one of them edited: sums of the archive agree with it."""
    with np.load(io.BytesIO(originals().resume)) as data:
        arrays = {name: data[name] for name in data.files}
    members = {f"{name}.npy": _npy(array) for name, array in arrays.items()}
    name = dice.choice(sorted(arrays))
    how = dice.choice(["edit", "edit", "edit", "edit", "bytes", "header", "kind"])
    if how == "edit" and name != "values":
        text = text_of(json.loads(arrays[name].tobytes()), dice)
        array = np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8)
        return members | {f"{name}.npy": _npy(array)}
    if how == "edit":
        values = arrays[name].copy()
        values[dice.randrange(values.size)] = dice.choice([np.nan, np.inf, 1e308, -3.0, 0.0, 1e3])
        return members | {f"{name}.npy": _npy(values[: dice.choice([values.size, 10, -1])])}
    if how == "kind":
        kind = dice.choice(["<f4", ">f8", "<c16", "S8", "<M8[s]"])
        return members | {f"{name}.npy": _npy(arrays[name].astype(kind))}
    content = members[f"{name}.npy"]
    if how == "header":
        shape = dice.choice([b"(1099511627776,)", b"(-1,)", b"()", b"(0,)", b"(2, 2)"])
        start = content.index(b"(")
        end = content.index(b")") + 1
        room = content[start : content.index(b"\n")].replace(content[start:end], shape, 1)
        content = content[:start] + room + content[content.index(b"\n") :]
    return members | {f"{name}.npy": flipped(content, dice) if how == "bytes" else content}


def _npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _archive(dice: random.Random, members: dict[str, bytes]) -> bytes:
    """The members in an archive, sometimes compressed, sometimes with others beside them."""
    how = dice.choice(["stored"] * 8 + ["deflated", "more", "bomb", "path"])
    packed = zipfile.ZIP_DEFLATED if how in ("deflated", "bomb") else zipfile.ZIP_STORED
    if how == "bomb":
        members = members | {"values.npy": members["values.npy"] + bytes(30_000_000)}
    if how in ("more", "path"):
        members = members | {"more.npy" if how == "more" else "../outside.npy": b"x"}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", packed) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


# --- judging -----------------------------------------------------------------------------------


@dataclass
class Tally:
    """What came of the cases."""

    tried: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0


def judged(kind: str, folder: Path, tally: Tally) -> None:
    """Read the file of a kind in a folder, and what it is if it is anything."""
    began = time.process_time()
    name = "solution.nc" if kind == "solution" else "resume.npz"
    seconds = None
    try:
        if kind == "solution":
            plan = load_plan(folder, throw=False)
            seconds = time.process_time() - began
        else:
            checkpoint = Checkpoint(folder / name, resume=True)
            plan = plan_motion(originals().motion, 1, checkpoint=checkpoint, throw=False)
        outcome = plan.status.name.lower()
        if plan.status is Status.SOLVED:
            problem = plan.motion.spec.model_dump(mode="json", exclude_none=True)
            tally.faults += [
                f"{kind}: called solved, but {wrong}" for wrong in wrongs(problem, plan)
            ]
    except InputError as error:
        outcome = "refused"
        seconds = time.process_time() - began
        if name not in str(error) or not str(error).isprintable():
            tally.faults.append(f"{kind}: told so: {error!r}")
    except Exception:
        outcome = "crashed"
        tally.faults.append(f"{kind}: {traceback.format_exc()}")
    if seconds is not None:
        tally.slowest = max(tally.slowest, seconds)
        if seconds > SECONDS:
            tally.faults.append(f"{kind}: read in {seconds:.2f} s, then {outcome}")
    tally.tried[kind] += 1
    tally.outcomes[f"{kind}: {outcome}"] += 1


def _odd_files(folder: Path, tally: Tally) -> None:
    """What is no regular file: a pipe that nobody writes to, a device without end, a folder."""
    for kind, name in (("solution", "solution.nc"), ("resume", "resume.npz")):
        path = folder / name
        makers: list[Callable[[], object]] = [
            lambda path=path: os.mkfifo(path),  # type: ignore[misc]
            lambda path=path: path.symlink_to("/dev/zero"),  # type: ignore[misc]
            lambda path=path: path.mkdir(),  # type: ignore[misc]
        ]
        for make in makers:
            make()
            judged(kind, folder, tally)
            path.rmdir() if path.is_dir() else path.unlink()


def _here(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def run(
    count: int, seed: int, progress: Callable[[str], object] = lambda line: None
) -> dict[str, Any]:
    """Try `count` files made with a seed; what came of them, in numbers.

    Returns
    -------
    "tried" by kind, "outcomes", "faults" in words, "slowest" reading in s of processor time, and
    "megabytes" by which the memory of the process has grown.
    """
    dice, tally = random.Random(seed), Tally()
    original = originals()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        folder.mkdir()
        (Path(name) / "beside.txt").write_text("mine")
        (folder / ".x.part").write_text("mine")
        save_plan(original.plan, folder)
        judged("solution", folder, tally)  # and all that is made once is made
        (folder / "solution.nc").unlink()
        before, began = _here(Path(name)), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        _odd_files(folder, tally)
        for number in range(1, count + 1):
            faulthandler.dump_traceback_later(PATIENCE, exit=True)
            kind = dice.choice(["solution", "resume"])
            path = folder / ("solution.nc" if kind == "solution" else "resume.npz")
            path.write_bytes(solution(dice) if kind == "solution" else unfinished(dice))
            judged(kind, folder, tally)
            for left in (path, folder / "resume-newer.npz"):
                left.unlink(missing_ok=True)
            if _here(Path(name)) != before:
                tally.faults.append(f"{kind}: other files were changed")
                before = _here(Path(name))
            if number % 100 == 0:
                progress(f"{number}: {dict(tally.outcomes)}, {len(tally.faults)} faults")
    faulthandler.cancel_dump_traceback_later()
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - began) / 1024
    if grown > MEGABYTES:
        tally.faults.append(f"memory has grown by {grown:.0f} MB")
    return {
        "seed": seed,
        "tried": dict(tally.tried),
        "outcomes": dict(tally.outcomes),
        "faults": tally.faults,
        "slowest": round(tally.slowest, 3),
        "megabytes": round(grown),
    }


def main() -> None:
    """Command line of a run; exits with 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description="Try damaged and hostile saved files.")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="where to write the numbers")
    options = parser.parse_args()
    report = run(options.count, options.seed, progress=lambda line: print(line, flush=True))
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(report, indent=2) + "\n")
    print(json.dumps({**report, "faults": report["faults"][:10]}, indent=1))
    sys.exit(1 if report["faults"] else 0)


if __name__ == "__main__":
    main()
