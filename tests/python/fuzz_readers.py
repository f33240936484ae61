"""Coverage-guided fuzzing of every reader, by atheris (`pip install atheris`), outside CI.

    python tests/python/fuzz_readers.py vtu out/fuzz-vtu -max_total_time=600

Beside what `./run fuzz files` spoils blindly, this follows the branches of sheetsplat.io. The first argument is a kind
of tests/python/readable_files.py, blanks as "_"; the second is a folder for what was found to be interesting. What is
left are libFuzzer's own options. Anything that is neither a field nor an Error of the package ends it, and the file is
kept.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["sheetsplat"]):
    import sheetsplat as ss
    import sheetsplat.io.dicom
    import sheetsplat.io.gaussian_ply
    import sheetsplat.io.hdf5_volumes
    import sheetsplat.io.mesh_files
    import sheetsplat.io.metaimage
    import sheetsplat.io.mrc
    import sheetsplat.io.netcdf
    import sheetsplat.io.nifti
    import sheetsplat.io.nrrd_files
    import sheetsplat.io.numpy_files
    import sheetsplat.io.pictures
    import sheetsplat.io.plot3d
    import sheetsplat.io.sph_hdf5
    import sheetsplat.io.tables
    import sheetsplat.io.tiff
    import sheetsplat.io.vtk_hdf
    import sheetsplat.io.vtk_legacy
    import sheetsplat.io.vtk_xml.blocks
    import sheetsplat.io.vtk_xml.images
    import sheetsplat.io.vtk_xml.meshes
    import sheetsplat.io.vtk_xml.pieces
    import sheetsplat.io.zarr_folders

from readable_files import KINDS, read, write


def main() -> None:
    """Fuzz one kind of file."""
    kind, folder = sys.argv[1].replace("_", " "), Path(sys.argv[2])
    if kind not in KINDS:
        sys.exit(f"{kind} is no kind of file; these are: {', '.join(KINDS)}")
    corpus, work = folder / "corpus", folder / "work"
    for one in (corpus, work):
        one.mkdir(parents=True, exist_ok=True)
    files = KINDS[kind](work)
    first = next(iter(files))
    write(work, files)
    (corpus / "valid").write_bytes(files[first])
    warnings.simplefilter("ignore")

    def look(data: bytes) -> None:
        (work / first).write_bytes(data)
        try:
            read(kind, work / first)
        except ss.Error:
            pass

    options = ["-rss_limit_mb=1500", "-timeout=20", f"-artifact_prefix={folder}/found-", *sys.argv[3:], str(corpus)]
    atheris.Setup([sys.argv[0], *options], look)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
