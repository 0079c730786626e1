"""SimpleITK, driven line by line: what `peers.py` asks of it, one JSON object on stdin for each task, one on stdout
for each answer. It runs in the environment that `peers.py` makes, which has SimpleITK and numpy."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import SimpleITK as sitk

# Of the built-in head, HU: a finer head has noise of the same strength, so that it compresses as well as a scan does.
NOISE_HU = 10.0


class Worker:
    """Keeps the CT and the field in memory: SimpleITK is timed without reading them."""

    def __init__(self, threads):
        sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
        self.ct = None
        self.field = None
        self.transform = None
        self.warped = None

    def version(self, _):
        return {"version": sitk.Version.VersionString()}

    def load(self, task):
        """The CT, and the field that `rhinoplan` wrote: mm, LPS, from the warped CT's voxels to the CT."""
        self.ct = sitk.ReadImage(task["ct"])
        self.field = displacement(task["field"], self.ct)
        # A transform takes over the field that it is given: it gets its own.
        self.transform = sitk.DisplacementFieldTransform(sitk.Image(self.field))
        # The same for a program that cannot read a NIfTI of vectors.
        sitk.WriteImage(sitk.Cast(self.field, sitk.sitkVectorFloat32), task["field_to"])
        return {}

    def warp(self, _):
        return self.timed(lambda: sitk.Warp(
            self.ct, self.field, interpolator=sitk.sitkLinear, outputSize=self.ct.GetSize(),
            outputOrigin=self.ct.GetOrigin(), outputSpacing=self.ct.GetSpacing(),
            outputDirection=self.ct.GetDirection(), edgePaddingValue=-1000))

    def resample(self, _):
        return self.timed(lambda: sitk.Resample(
            self.ct, self.ct, self.transform, sitk.sitkLinear, -1000.0, self.ct.GetPixelID()))

    def copy(self, _):
        samples = sitk.GetArrayViewFromImage(self.ct)
        to = np.empty_like(samples)
        to.fill(0)
        return self.timed(lambda: np.copyto(to, samples), keep=False)

    def write(self, task):
        """The CT warped by SimpleITK, compressed."""
        return self.timed(lambda: sitk.WriteImage(self.warped, task["to"], True), keep=False)

    def timed(self, work, keep=True):
        start = time.perf_counter()
        result = work()
        seconds = time.perf_counter() - start
        if keep:
            self.warped = result
        return {"seconds": seconds}

    def agrees(self, task):
        """The share of voxels where a CT differs by more than 1 HU from that which SimpleITK warped last: whether both
        do the same work. What comes from outside the CT is left out: both are free to put something else there."""
        other = sitk.GetArrayFromImage(sitk.ReadImage(task["volume"]))
        ours = sitk.GetArrayFromImage(self.warped)
        differ = np.abs(other.astype(np.int32) - ours) > 1
        field = sitk.GetArrayViewFromImage(self.field)
        for axis, (size, spacing) in enumerate(zip(self.ct.GetSize(), self.ct.GetSpacing())):
            along = [1, 1, 1]
            along[2 - axis] = size
            source = np.arange(size).reshape(along) + field[..., axis] / spacing
            differ &= (source >= 0.01) & (source <= size - 1.01)
        return {"differ": float(np.mean(differ))}

    def field_error(self, task):
        """The largest distance between two displacements, voxels."""
        one, other = (displacement(task[key], self.ct) for key in ("one", "other"))
        apart = sitk.GetArrayFromImage(one) - sitk.GetArrayFromImage(other)
        apart /= np.array(self.ct.GetSpacing())
        return {"voxels": float(np.sqrt(np.max(np.sum(apart * apart, axis=-1))))}

    def finer(self, task):
        """The CT with more voxels in the same space, with noise."""
        ct = sitk.Cast(sitk.ReadImage(task["ct"]), sitk.sitkFloat32)
        size = task["size"]
        spacing = [s * (n - 1) / (m - 1) for s, n, m in zip(ct.GetSpacing(), ct.GetSize(), size)]
        smooth = sitk.DiscreteGaussian(ct, [0.5 * s * s for s in ct.GetSpacing()])
        finer = sitk.Resample(smooth, size, sitk.Transform(), sitk.sitkLinear, ct.GetOrigin(), spacing,
                              ct.GetDirection(), -1000.0, sitk.sitkFloat32)
        samples = sitk.GetArrayFromImage(finer)
        random = np.random.default_rng(2001)
        for plane in samples:
            plane += random.normal(0.0, NOISE_HU, plane.shape).astype(np.float32)
        image = sitk.GetImageFromArray(np.clip(np.rint(samples), -1024, 3071).astype(np.int16))
        image.SetSpacing(spacing)
        image.SetOrigin(ct.GetOrigin())
        image.SetDirection(ct.GetDirection())
        Path(task["to"]).parent.mkdir(parents=True, exist_ok=True)
        sitk.WriteImage(image, task["to"], True)
        return {}


def displacement(path, ct):
    """A displacement field as vectors of float64, on the CT's own grid (which a header of 32-bit floats rounds)."""
    field = sitk.ReadImage(path)
    if field.GetNumberOfComponentsPerPixel() != 3 or field.GetSize() != ct.GetSize():
        raise ValueError("not a displacement field on the CT's grid")
    field = sitk.Cast(field, sitk.sitkVectorFloat64)
    field.CopyInformation(ct)
    return field


def main():
    worker = Worker(int(sys.argv[1]))
    for line in sys.stdin:
        task = json.loads(line)
        try:
            answer = getattr(worker, task["do"])(task)
        except Exception as error:  # told to the one who asked, who stops
            answer = {"error": f"{task['do']}: {error}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
