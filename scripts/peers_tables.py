"""The tables that `peers.py` prints and `docs/performance.md` holds, of medians: seconds and bytes."""

import ast


def shown(seconds):
    if seconds is None:
        return "not measured"
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.2f} s"


def times(ratio):
    return f"{ratio:.1f} ×" if ratio < 10 else f"{ratio:.0f} ×"


def mib(count):
    return "not measured" if count is None else f"{count / 2**20:.0f} MiB"


class Table:
    def __init__(self):
        self.rows = []

    def row(self, work, bar, reached, peer="", ratio="", met=None):
        verdict = {None: "", True: "yes", False: "**no**"}[met]
        self.rows.append((work, bar, reached, peer, ratio, verdict))

    def against(self, work, ours, peer_name, theirs, faster=None, most=None):
        """A time, held against a peer's, and against a limit."""
        ratio = theirs / ours if ours and theirs else None
        bars, kept = [], []
        if most is not None:
            bars.append(f"≤ {shown(most)}")
            kept.append(None if ours is None else ours <= most)
        if faster is not None:
            bars.append(f"≥ {faster:g} × faster")
            kept.append(None if ratio is None else ratio >= faster)
        known = [one for one in kept if one is not None]
        met = all(known) if known and (len(known) == len(kept) or not all(known)) else None
        peer = f"{peer_name}: {shown(theirs)}" if peer_name else ""
        self.row(work, ", ".join(bars), shown(ours), peer, times(ratio) if ratio else "", met)

    def text(self):
        return lines([("work", "bar", "reached", "peer", "ratio", "met"), ("---",) * 6, *self.rows])


def lines(rows):
    """A table in Markdown."""
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def against_peers(m, ratio, error, has_plastimatch, size, large_size):
    """Every bar, what was reached, and the peer: `m` gives the median of a thing and a quantity, or None; `ratio`
    the median of one thing's in another's of the same round; `error` is the largest distance of adaptive from exact,
    voxels; the sizes count voxels."""
    made = Table()
    warp, warp_name = m("itk warp"), "SimpleITK `Warp`"
    lm, lm_name = m("lm-warp tps"), "plastimatch `lm-warp`" if has_plastimatch else "plastimatch is not installed"
    made.against("copy of the volume", m("copy"), "numpy", m("numpy copy"))
    made.against("`lee2001`, full scale, one stage, `exact`: morph phase", m("exact", "morph"), warp_name, warp, 2.5)
    made.against("the same, `adaptive` at 0.1 voxel", m("adaptive", "morph"), warp_name, warp, 6)
    made.row("its largest distance from `exact`", "≤ 0.1 voxel", f"{error:.3f} voxel", met=error <= 0.1)
    made.against("`adaptive` with 50 extra lines (library)", m("morph_extra_lines_adaptive"), "`exact`",
                 m("morph_extra_lines_exact"), 8)
    made.against("`local`, full scale, one stage: morph phase", m("local", "morph"), warp_name, warp, 15)
    made.against("`lee2001`, full scale, `exact`: morph phase", m("exact", "morph"), "SimpleITK `Resample`",
                 m("itk resample"))
    made.against("half scale down", m("half", "half"), "", None, most=0.025)
    made.against("Gaussian up", m("half", "upsample"), "", None, most=0.025)
    made.against("half scale: morph phase", m("half", "morph"), "", None)
    made.against("semi-boundary of the skin (library)", m("surface_skin"), "", None, most=0.025)
    made.against("one 1024² view (library)", m("view_frontal"), "", None, most=0.015)
    made.against("writing `volume.nii.gz`", m("exact", "write-volume"), "SimpleITK", m("itk write"))
    made.against("whole `run`, `local`, tables and `volume.nii.gz`", m("local"), lm_name, lm, 10, 0.6)
    for model in ("adaptive", "exact"):
        made.against(f"the same, `lee2001` `{model}`", m(model), lm_name, lm, 10, 0.6)
    if has_plastimatch:
        made.against("the same as the last", m("exact"), "plastimatch `lm-warp`, Wendland", m("lm-warp wendland"))
        made.against("the same", m("exact"), "plastimatch `warp`, field given", m("warp"))
    made.against("whole `run`, `local`, tables only", m("local-tables"), "", None, most=0.35)
    made.against("the same, `lee2001` `exact`", m("exact-tables"), "", None, most=0.35)
    most = 3 * 2 * size + 40e6
    for model in ("local", "exact"):
        held, peer = m(model, "bytes"), m("lm-warp tps", "bytes")
        made.row(f"peak memory of the run with `volume.nii.gz`, {named(model)}", f"≤ {mib(most)}", mib(held),
                 f"{lm_name}: {mib(peer)}" if has_plastimatch else lm_name,
                 times(peer / held) if peer else "", held <= most)
    for work, one, two in (
            ("morph, `exact`", m("exact-one-thread", "morph"), m("exact", "morph")),
            ("morph, `adaptive`", m("adaptive-one-thread", "morph"), m("adaptive", "morph")),
            ("one 1024² view (library)", m("view_frontal one thread"), m("view_frontal"))):
        made.against(f"two threads: {work}", two, "one thread", one, 1.7)
    more = large_size / size
    for model in ("exact", "adaptive", "local"):
        for work, quantity in (("morph phase", "morph"), ("whole `run`", "wall"), ("peak memory", "bytes")):
            small, large = m(model, quantity), m(f"{model}-large", quantity)
            show = mib if quantity == "bytes" else shown
            change = ratio(f"{model}-large", model, quantity) / more - 1
            made.row(f"512×512×400, {named(model)}: {work}", "at most 15 % more for each voxel", show(large),
                     f"320×320×151: {show(small)}", f"{100 * change:+.0f} %", change <= 0.15)
    return made.text()


def named(model):
    return "`local`" if model == "local" else f"`lee2001` `{model}`"


# Seconds, Tables III and IV, first operation.
TABLE_III = (
    ("half scale down", 1.52, "half", "half"),
    ("volume morphing (half scale)", 9.94, "half", "morph"),
    ("creating the semi-boundary (library)", 2.75, "surface_skin", "wall"),
    ("rendering it, one 1024² view (library)", 0.11, "view_frontal", "wall"),
    ("back to full scale", 1.53, "half", "upsample"),
    ("measurements", 0.10, "half", "measure"),
)
TABLE_IV = (
    ("half scale, optimised: `adaptive`", 9.94, "half"),
    ("half scale, not optimised: `exact`", 204.21, "half-exact"),
    ("full scale, optimised: `adaptive`", 119.21, "adaptive"),
    ("full scale, not optimised: `exact`", 1628.31, "exact"),
)


def beside_the_paper(m):
    """Tables III and IV."""
    rows = [("work", "paper", "rhinoplan", "ratio"), ("---",) * 4]
    for work, paper, thing, quantity in (
            *((f"III: {work}", *rest) for work, *rest in TABLE_III),
            *((f"IV: morphing, {work}", paper, thing, "morph") for work, paper, thing in TABLE_IV)):
        ours = m(thing, quantity)
        rows.append((work, f"{paper:.2f} s", shown(ours), times(paper / ours) if ours else ""))
    return lines(rows)


def growth(found, steps, varied):
    """Medians of benches by size, and by whatever else they are given; `found` has them by name and argument."""
    sizes = sorted({size for name, size in found if name in steps}, key=count)
    rows = [("bench", *("×".join(map(str, ast.literal_eval(size))) for size in sizes)), ("---",) * (len(sizes) + 1)]
    for name in steps:
        cells = []
        for size in sizes:
            seconds = found.get((name, size))
            each = f" ({1e9 * seconds / count(size):.3g} ns a voxel)" if seconds and name != "view_frontal" else ""
            cells.append(shown(seconds) + each)
        rows.append((f"`{name}`", *cells))
    parts = [lines(rows)]
    for name in varied:
        arguments = [argument for bench, argument in found if bench == name]
        if arguments:
            medians = [shown(found[name, argument]) for argument in arguments]
            parts.append(lines([(f"`{name}`", *arguments), ("---",) * (len(arguments) + 1), ("median", *medians)]))
    return "\n\n".join(parts)


def count(size):
    """Voxels of a bench's argument, as `[320, 320, 151]`."""
    x, y, z = ast.literal_eval(size)
    return x * y * z
