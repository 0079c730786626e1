#!/usr/bin/env python3
"""Times rhinoplan beside its peers, in one run, and prints one Markdown table: `docs/performance.md` holds it.

    python3 scripts/peers.py [--rounds 5] [--update] [--keep]

Builds rhinoplan and its benches (release), makes the built-in head (320x320x151, int16) and the same head with the
voxels of a clinical CT (512x512x400), and then does everything in turn, round after round, so that whatever else the
machine does in the meantime is shared out. Figures are medians.

Peers come from package registries: SimpleITK from PyPI, into an environment in `target/peers`; plastimatch from Debian
(`apt-get install plastimatch`), left out, with a word in its rows, where it is missing. Needs Python 3.9 or later,
Linux, about 3 GB of memory and 2 GB of disk.
"""

import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
import venv
from pathlib import Path

import peers_tables as tables

PROJECT = Path(__file__).resolve().parent.parent
WORK = PROJECT / "target" / "peers"
THREADS = 2

SIZE, LARGE = (320, 320, 151), (512, 512, 400)
SPACING = (0.442, 0.442, 1.0)
# The built-in head's, voxels of its own grid; the CTs begin at the LPS origin, so index x spacing is LPS.
LANDMARKS = {
    "nasal_bones": (141.089, 71.61, 78.882),
    "lip": (141.089, 67.61, 53.121),
    "alare_right": (96.0, 60.0, 60.0),
    "alare_left": (186.0, 60.0, 60.0),
    "tip": (129.0, 33.0, 61.0),
    "maxilla": (141.089, 83.61, 60.0),
}
# The paper's first operation: the tip 20 voxels to the left.
MOVE_MM = (8.84, 0.0, 0.0)
# How far Wendland's function of a landmark reaches: about the width of a face.
WENDLAND_MM = 60.0


def voxels(size):
    return size[0] * size[1] * size[2]


def lps(name):
    return [index * step for index, step in zip(LANDMARKS[name], SPACING)]


# What runs.


def plan(name, ct, morph, write):
    points = "\n".join(f"{point} = {[round(v, 6) for v in lps(point)]}" for point in LANDMARKS)
    keys = "\n".join(f"{key} = {value}" for key, value in morph.items())
    outputs = f"[outputs]\nwrite = {json.dumps(write)}\n" if write else ""
    views = '[views]\nnames = ["frontal"]\nsize = 1024\n' if "views" in write else ""
    return f"""plan = 1
name = "{name}"
[ct]
path = "{ct}"
[landmarks]
frame = "lps"
{points}
[morph]
{keys}
[[candidate]]
name = "straight"
[[candidate.stage]]
name = "straighten"
f1 = [{{ move_tip = {{ mm = {list(MOVE_MM)} }} }}]
{outputs}{views}"""


EXACT = {"model": '"lee2001"', "scale": '"full"', "method": '"exact"'}
ADAPTIVE = {"model": '"lee2001"', "scale": '"full"', "tolerance": "{ voxels = 0.1 }"}
LOCAL = {"model": '"local"', "scale": '"full"'}
HALF = {"model": '"lee2001"', "scale": '"half"', "tolerance": "{ voxels = 0.1 }"}
HALF_EXACT = {"model": '"lee2001"', "scale": '"half"', "method": '"exact"'}
# name: CT, [morph], outputs, threads
RUNS = {
    "exact": ("ct", EXACT, ["volume"], 2),
    "exact-one-thread": ("ct", EXACT, ["volume"], 1),
    "adaptive": ("ct", ADAPTIVE, ["volume"], 2),
    "adaptive-one-thread": ("ct", ADAPTIVE, ["volume"], 1),
    "half": ("ct", HALF, ["volume"], 2),
    "half-exact": ("ct", HALF_EXACT, ["volume"], 2),
    "local": ("ct", LOCAL, ["volume"], 2),
    "local-tables": ("ct", LOCAL, [], 2),
    "exact-tables": ("ct", EXACT, [], 2),
    "exact-large": ("large", EXACT, ["volume"], 2),
    "adaptive-large": ("large", ADAPTIVE, ["volume"], 2),
    "local-large": ("large", LOCAL, ["volume"], 2),
}
# Library calls, by their names in benches/pipeline.rs, on SIZE.
BENCHES = ["copy", "surface_skin", "view_frontal", "morph_extra_lines_exact", "morph_extra_lines_adaptive"]
# How cost grows: steps at every size, and what else is varied.
STEPS = ["morph_lee2001_exact", "morph_lee2001_adaptive", "morph_local_adaptive", "audit_lee2001", "half_down",
         "gaussian_up", "measure_regions", "segment_skin", "surface_skin", "view_frontal", "read_gz", "write_gz",
         "whole_run"]
VARIED = ["morph_lee2001_tolerance", "morph_lines_exact", "morph_lines_adaptive", "simd_lee2001_exact",
          "simd_lee2001_adaptive", "simd_local_adaptive"]


def measured_process(command, threads):
    """Runs a program to its end: seconds from start to end, and the most memory that it held, bytes."""
    env = dict(os.environ, OMP_NUM_THREADS=str(threads), RAYON_NUM_THREADS=str(threads))
    log = WORK / "log.txt"
    with open(log, "wb") as to:
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=to, stderr=subprocess.STDOUT, env=env, cwd=WORK)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{command[0]} ended with {process.returncode}:\n{log.read_text(errors='replace')[-2000:]}")
    return {"wall": seconds, "bytes": usage.ru_maxrss * 1024}


class Rhinoplan:
    def __init__(self):
        build = ["cargo", "build", "--release", "--locked", "--bin", "rhinoplan"]
        self.program = built(build, "bin", "rhinoplan")
        self.bench = built(["cargo", "bench", "--no-run", "--locked", "--bench", "pipeline"], "bench", "pipeline")
        for name, (ct, morph, write, _) in RUNS.items():
            self.write_plan(name, ct, morph, write)

    @staticmethod
    def write_plan(name, ct, morph, write):
        (WORK / f"{name}.toml").write_text(plan(name, f"{ct}.nii.gz", morph, write))

    def run(self, name, threads):
        shutil.rmtree(WORK / "out" / name, ignore_errors=True)
        command = [self.program, "run", f"{name}.toml", "--quiet", "--force", "--threads", str(threads)]
        found = measured_process(command, threads)
        timings = json.loads((WORK / "out" / name / "timings.json").read_text())
        for phase in timings["phases"]:
            found[phase["phase"]] = found.get(phase["phase"], 0.0) + phase["seconds"]
        return found

    def output(self, name, file):
        return WORK / "out" / name / "straight" / "01-straighten" / file

    def benches(self, names, threads, argument=""):
        """Medians of benches, seconds, by name and argument."""
        env = dict(os.environ, RAYON_NUM_THREADS=str(threads))
        pattern = rf"\b({'|'.join(names)})::{argument}"
        text = subprocess.run([self.bench, "--bench", "--color", "never", pattern], check=True, text=True, env=env,
                              stdout=subprocess.PIPE, cwd=WORK).stdout
        return divan_medians(text)

    def at_size(self, names, threads):
        """The same of SIZE alone, by name."""
        found = self.benches(names, threads, re.escape(str(list(SIZE))))
        return {name: median for (name, _), median in found.items()}


def divan_medians(text):
    """The column `median` of what divan prints: a line with a bench's name, then one for each argument."""
    scale = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}
    found, name = {}, None
    for line in text.splitlines():
        line = re.match(r"[│ ]*[├╰]─ (.*?)(?:  +|$)(.*)", line)
        times = re.findall(r"([\d.]+) (ns|µs|ms|s)\b", line[2]) if line else []
        if line and len(times) == 4:
            # fastest, slowest, median, mean
            value, unit = times[2]
            found[name, line[1]] = float(value) * scale[unit]
        elif line:
            name = line[1]
    return found


def built(command, kind, name):
    """Has cargo build something, and returns where it put it."""
    say(" ".join(command))
    text = subprocess.run(command + ["--message-format=json-render-diagnostics"], cwd=PROJECT, check=True,
                          stdout=subprocess.PIPE, text=True).stdout
    for line in text.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["target"]["name"] == name and kind in message["target"]["kind"]:
            return message["executable"]
    raise SystemExit(f"cargo built no {name}")


class Itk:
    """SimpleITK in a process of its own (`peers_itk.py`)."""

    def __init__(self):
        home = WORK / "venv"
        python = home / "bin" / "python"
        if not python.exists():
            say("installing SimpleITK")
            venv.create(home, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "SimpleITK", "numpy"],
                       check=True)
        script = Path(__file__).with_name("peers_itk.py")
        self.process = subprocess.Popen([python, script, str(THREADS)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        text=True, cwd=WORK)
        self.name = f"SimpleITK {self.ask('version')['version']}"

    def ask(self, do, **task):
        self.process.stdin.write(json.dumps({"do": do, **task}) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        answer = json.loads(line) if line else {"error": "SimpleITK ended"}
        if "error" in answer:
            raise SystemExit(answer["error"])
        return answer

    def seconds(self, do, **task):
        return self.ask(do, **task)["seconds"]

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class Plastimatch:
    """Commands from file to file; none where the program is missing."""

    def __init__(self):
        self.program = shutil.which("plastimatch")
        self.commands = {}
        if not self.program:
            return
        version = subprocess.run([self.program, "--version"], stdout=subprocess.PIPE, text=True).stdout
        self.name = f"plastimatch {version.split()[-1]}"
        moved = {"tip": [at + by for at, by in zip(lps("tip"), MOVE_MM)]}
        for file, points in (("fixed", {**{name: lps(name) for name in LANDMARKS}, **moved}),
                             ("moving", {name: lps(name) for name in LANDMARKS})):
            # Slicer's format, in RAS.
            lines = [f"{name},{-x:.6f},{-y:.6f},{z:.6f},1,1" for name, (x, y, z) in points.items()]
            heading = ["# Fiducial List file", "# columns = label,x,y,z,sel,vis"]
            (WORK / f"{file}.fcsv").write_text("\n".join(heading + lines) + "\n")
        landmarks = ["--fixed", "ct.nii.gz", "--input-image", "ct.nii.gz", "--fixed-landmarks", "fixed.fcsv",
                     "--moving-landmarks", "moving.fcsv", "--default-value", "-1000"]
        self.commands = {
            "warp": ["warp", "--input", "ct.nii.gz", "--xf", "field.mha", "--interpolation", "linear",
                     "--default-value", "-1000", "--output-type", "short", "--output-img", "peer-warp.nii.gz"],
            "lm-warp tps": ["lm-warp", "--algorithm", "tps", *landmarks, "--output-image", "peer-tps.nii.gz"],
            "lm-warp wendland": ["lm-warp", "--algorithm", "wendland", "--radius", str(WENDLAND_MM), *landmarks,
                                 "--output-image", "peer-wendland.nii.gz"],
        }

    def run(self, name):
        return measured_process([self.program, *self.commands[name]], THREADS)


# In turn.


class Samples:
    """What was measured: a list of values for each thing and quantity."""

    def __init__(self):
        self.values = {}

    def add(self, thing, found):
        for quantity, value in found.items():
            self.values.setdefault((thing, quantity), []).append(value)

    def median(self, thing, quantity="wall"):
        values = self.values.get((thing, quantity))
        return statistics.median(values) if values else None

    def ratio(self, thing, other, quantity):
        """Of what was done in the same round: where the machine is slow for a while, it is so for both."""
        pairs = zip(self.values[thing, quantity], self.values[other, quantity])
        return statistics.median(one / two for one, two in pairs)


def prepare(rhinoplan, itk):
    """Files that all read, the field of the exact map among them, and whether all do the same work."""
    say("making the CTs and the field")
    subprocess.run([rhinoplan.program, "phantom", "--quiet", "-o", "ct.nii.gz"], check=True, cwd=WORK,
                   stdout=subprocess.DEVNULL)
    itk.ask("finer", ct="ct.nii.gz", size=LARGE, to="large.nii.gz")
    for name, morph in (("field-exact", EXACT), ("field-adaptive", ADAPTIVE)):
        rhinoplan.write_plan(name, "ct.nii.gz".removesuffix(".nii.gz"), morph, ["volume", "displacement"])
        rhinoplan.run(name, THREADS)
    field, other = (str(rhinoplan.output(name, "displacement.nii.gz")) for name in ("field-exact", "field-adaptive"))
    itk.ask("load", ct="ct.nii.gz", field=field, field_to="field.mha")
    volume = str(rhinoplan.output("field-exact", "volume.nii.gz"))
    for do in ("resample", "warp"):
        itk.ask(do)
        # Positions of 32-bit floats round a little differently.
        differ = itk.ask("agrees", volume=volume)["differ"]
        say(f"SimpleITK {do}: {100 * differ:.3f} % of all voxels differ by more than 1 HU")
        if differ > 0.001:
            raise SystemExit("SimpleITK computes something else")
    return itk.ask("field_error", one=field, other=other)["voxels"]


def measure(rhinoplan, itk, plastimatch, rounds):
    samples = Samples()
    for number in range(rounds):
        say(f"round {number + 1} of {rounds}")
        for name, (_, _, _, threads) in RUNS.items():
            samples.add(name, rhinoplan.run(name, threads))
            # A peer after each of the runs that are held against it.
            if name in ("exact", "adaptive", "local"):
                samples.add("itk warp", {"wall": itk.seconds("warp")})
        samples.add("itk resample", {"wall": itk.seconds("resample")})
        samples.add("itk write", {"wall": itk.seconds("write", to="peer-itk.nii.gz")})
        samples.add("numpy copy", {"wall": itk.seconds("copy")})
        for name in plastimatch.commands:
            samples.add(name, plastimatch.run(name))
        for name, seconds in rhinoplan.at_size(BENCHES, THREADS).items():
            samples.add(name, {"wall": seconds})
        for name, seconds in rhinoplan.at_size(["view_frontal"], 1).items():
            samples.add(f"{name} one thread", {"wall": seconds})
    return samples


def machine():
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        text = ""
    model = re.search(r"model name\s*: (.*)", text)
    return f"{model[1] if model else 'unknown processor'}, {os.cpu_count()} cores"


def say(text):
    print(text, file=sys.stderr, flush=True)


def put(page, name, text):
    """Puts a text between the two comments that name it."""
    pattern = re.compile(rf"(<!-- {name}\b[^\n]*-->\n).*?(<!-- /{name} -->)", re.DOTALL)
    page, count = pattern.subn(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)
    if count != 1:
        raise SystemExit(f"the page has no place for {name}")
    return page


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--rounds", type=int, default=5, help="how often everything is done; 5 or more for figures")
    options.add_argument("--update", action="store_true",
                         help="measure how cost grows as well, and put all tables into docs/performance.md")
    options.add_argument("--keep", action="store_true", help="keep the volumes (in target/peers)")
    given = options.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    rhinoplan, plastimatch, itk = Rhinoplan(), Plastimatch(), Itk()
    growth = {}
    try:
        error = prepare(rhinoplan, itk)
        samples = measure(rhinoplan, itk, plastimatch, given.rounds)
        if given.update:
            say("how cost grows")
            growth = rhinoplan.benches(STEPS + VARIED, THREADS)
    finally:
        itk.close()
        if not given.keep:
            for left in [*WORK.glob("*.nii.gz"), *WORK.glob("*.mha"), *WORK.glob("*.toml"), *WORK.glob("*.fcsv")]:
                left.unlink()
            shutil.rmtree(WORK / "out", ignore_errors=True)
    peers = [itk.name] + ([plastimatch.name] if plastimatch.commands else [])
    heading = (f"Medians of {given.rounds} rounds, {THREADS} threads, {machine()}, {', '.join(peers)}. How much more a "
               "voxel of the larger CT costs is the median of what it was in each round.")
    table = tables.against_peers(samples.median, samples.ratio, error, bool(plastimatch.commands), voxels(SIZE),
                                 voxels(LARGE))
    print(f"{heading}\n\n{table}")
    if given.update:
        path = PROJECT / "docs" / "performance.md"
        page = put(path.read_text(encoding="utf-8"), "peers", f"{heading}\n\n{table}")
        page = put(page, "paper", tables.beside_the_paper(samples.median))
        page = put(page, "growth", tables.growth(growth, STEPS, VARIED))
        path.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
