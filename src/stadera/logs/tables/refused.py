"""Files that are not read, with advice: pickles, which can run any code, unnamed arrays, archives."""

import zipfile
from pathlib import Path

_PICKLES = (".pkl", ".pickle")
_PICKLED = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
_UNSAFE = "a pickle can run any code and is not read; where you trust it, make a table of it in Python"


def refusal(path: Path) -> str:
    """Why a file is not read, with code that converts it; empty for any other file."""
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        head = file.read(128)
    name, npz = str(path), f"{path.stem}.npz"
    if head.startswith(_PICKLED) or path.suffix.lower() in _PICKLES:
        return f"{_UNSAFE}: import numpy, pickle; numpy.savez({npz!r}, **pickle.load(open({name!r}, 'rb')))"
    if head.startswith(b"PK") and zipfile.is_zipfile(path):
        return _of_zip(path, npz)
    if head.startswith(b"\x93NUMPY"):
        return _of_npy(head, name, npz)
    if b"MATLAB 7.3" in head[:16]:
        return f"MATLAB's version 7.3 is not read; save it again in MATLAB: save({f'{path.stem}_7.mat'!r}, ..., '-v7')"
    if head.startswith(b"\x89HDF"):
        return (
            f"HDF5 is not read; make a table of it in Python: import h5py, numpy; numpy.savez({npz!r}, "
            f"**{{k: v[()] for k, v in h5py.File({name!r}).items()}})"
        )
    return ""


def _of_zip(path: Path, npz: str) -> str:
    """For an archive that is not NumPy's: PyTorch's, or files to unpack."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if any(name.endswith("data.pkl") for name in names):
        return (
            f"{_UNSAFE}: import numpy, torch; numpy.savez({npz!r}, **{{k: v.numpy() for k, v in "
            f"torch.load({str(path)!r}, weights_only=True).items()}})"
        )
    if any(name.endswith(".npy") for name in names):
        return ""
    inside = ", ".join(names[:3]) + (" ..." if len(names) > 3 else "")
    return f"a zip archive; unpack it and give the log in it: {inside or 'it is empty'}"


def _of_npy(head: bytes, name: str, npz: str) -> str:
    if b"'|O'" in head:
        return f"{_UNSAFE}: import numpy; numpy.savez({npz!r}, **numpy.load({name!r}, allow_pickle=True).item())"
    return (
        "an array without names of columns; give it some in Python: import numpy; a = "
        f"numpy.load({name!r}); numpy.savez({npz!r}, time=a[:, 0], position=a[:, 1:13], joints=['FL_hip_joint', ...])"
    )
