"""A measurement of an acceleration written by the libraries of each format."""

import gzip
import struct
import wave
from datetime import datetime

import numpy as np

RATE = 12800.0
N = 12800


def signal():
    """An acceleration [g] that every format can hold exactly: multiples of 2⁻¹⁰ below 1, ten decimals."""
    t = np.arange(N) / RATE
    x = 0.5 * np.sin(2 * np.pi * 560 * t) + 0.1 * np.random.default_rng(1).normal(size=N).clip(-3, 3)
    return np.rint(x * 2**10) / 2**10


def as_wav16(path, x):
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(int(RATE))
        pair = np.stack([x, -x], axis=1)
        file.writeframes((pair * 2**15).astype("<i2").tobytes())


def as_wav24(path, x):
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(3)
        file.setframerate(int(RATE))
        values = (x * 2**23).astype("<i4")
        file.writeframes(b"".join(struct.pack("<i", v)[:3] for v in values.tolist()))


def as_wav_float(path, x):
    from scipy.io import wavfile

    wavfile.write(path, int(RATE), x.astype(np.float32))


def as_mat(path, x):
    from scipy.io import savemat

    savemat(path, {"run": {"acc": x[:, None], "fs": RATE}, "time": np.arange(N) / RATE})


def as_mat73(path, x):
    """By h5py, in the layout of MATLAB: a user block with its header, and its classes as attributes."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        run = file.create_group("run")
        run.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in (("acc", x[None, :]), ("fs", np.array([[RATE]])), ("time", np.arange(N)[None, :] / RATE)):
            data = run.create_dataset(name, data=values)
            data.attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def as_tdms(path, x):
    from nptdms import ChannelObject, TdmsWriter

    properties = {
        "wf_increment": 1 / RATE,
        "wf_start_offset": 0.0,
        "wf_start_time": datetime(2024, 5, 1, 12),
        "unit_string": "g",
    }
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("Run 1", "Acc1", x, properties=properties)])


def as_uff(path, x):
    import pyuff

    pyuff.UFF(str(path)).write_sets(
        pyuff.prepare_58(
            binary=0, func_type=1, rsp_node=3, rsp_dir=3, rsp_ent_name="housing", ref_ent_name="", ref_node=1,
            ref_dir=0, data=x,
            x=np.arange(N) / RATE, id1="run", abscissa_spacing=1, abscissa_inc=1 / RATE, abscissa_min=0.0,
            abscissa_spec_data_type=17, ordinate_spec_data_type=12, ordinate_axis_units_lab="g",
            orddenom_spec_data_type=0, z_axis_spec_data_type=0, ord_data_type=4, ver_num=0, load_case_id=0,
        ),
        "overwrite",
    )  # fmt: skip


def as_mdf(path, x):
    from asammdf import MDF, Signal

    file = MDF(version="4.10")
    file.append([Signal(samples=x, timestamps=np.arange(N) / RATE, name="Acc1", unit="g")])
    file.save(path, overwrite=True)
    file.close()


def as_hdf5(path, x):
    import h5py

    with h5py.File(path, "w") as file:
        data = file.create_dataset("run/acc", data=x)
        data.attrs["unit"] = "g"
        file["run"].attrs["fs"] = RATE


def as_parquet(path, x):
    import pyarrow as pa
    from pyarrow import parquet

    time = pa.array((np.arange(N) * 78125).astype("datetime64[ns]"))
    parquet.write_table(pa.table({"time": time, "Acc1 (g)": x}), path)


def as_csv(path, x):
    rows = "\n".join(f"{i / RATE!r},{v!r}" for i, v in enumerate(x.tolist()))
    path.write_text(f"Time (s),Acc1 (g)\n{rows}\n")


def as_csv_of_a_recorder(path, x):
    rows = "\n".join(f"{i / RATE:.9f};{v!r}".replace(".", ",") for i, v in enumerate(x.tolist()))
    head = "Messung;Prüfstand 3\nAbtastrate (Hz);12800\n\nZeit;Beschleunigung\n[s];[g]\n"
    path.write_bytes((head + rows).encode("cp1252"))


def as_csv_without_header(path, x):
    path.write_bytes(gzip.compress("\n".join(f"{i / RATE!r}\t{v!r}" for i, v in enumerate(x.tolist())).encode()))


def as_npz(path, x):
    np.savez(path, acc=x, sample_rate_hz=RATE)


def as_npy(path, x):
    np.save(path, np.stack([np.arange(N) / RATE, x], axis=1))


WRITERS = {
    "run.csv": as_csv, "recorder.csv": as_csv_of_a_recorder, "plain.csv.gz": as_csv_without_header, "run.npz": as_npz,
    "run.npy": as_npy, "run16.wav": as_wav16, "run24.wav": as_wav24, "float.wav": as_wav_float, "run.mat": as_mat,
    "run73.mat": as_mat73, "run.tdms": as_tdms, "run.uff": as_uff, "run.mf4": as_mdf, "run.h5": as_hdf5,
    "run.parquet": as_parquet,
}  # fmt: skip
"""By the name of a file; `WRITERS[name](path, signal())` writes it."""
