"""Recordings of some 80 MB of samples, made by the peers, and how each peer reads them."""

import gzip

import numpy as np

RATE_HZ = 16_384
CHANNELS = 8
SECONDS = 150
# Of the table, whose text is long.
TABLE_SECONDS = 60


def signal(seconds):
    """A tone in noise, by channel."""
    rng = np.random.default_rng(1)
    count = RATE_HZ * seconds
    return (np.sin(np.arange(count) * 0.37)[:, None] * 3 + rng.standard_normal((count, CHANNELS))).astype(np.float32)


def make_tdms(path):
    from nptdms import ChannelObject, TdmsWriter
    x = signal(SECONDS)
    with TdmsWriter(path) as file:
        for at in range(0, len(x), RATE_HZ):
            file.write_segment([ChannelObject("bench", f"acc_{c}", x[at:at + RATE_HZ, c], properties={"wf_increment": 1 / RATE_HZ, "unit_string": "m/s^2"}) for c in range(CHANNELS)])


def make_tdms_counts(path):
    """As a converter of 16 bits gives it, with its scale as a property."""
    from nptdms import ChannelObject, TdmsWriter
    x = np.round(signal(SECONDS) * 3000).astype(np.int16)
    scale = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 1 / 3000, "NI_Scale[0]_Linear_Y_Intercept": 0.0,
             "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF), "NI_Scaling_Status": "unscaled"}
    with TdmsWriter(path) as file:
        for at in range(0, len(x), RATE_HZ):
            file.write_segment([ChannelObject("bench", f"acc_{c}", x[at:at + RATE_HZ, c], properties={"wf_increment": 1 / RATE_HZ, "unit_string": "m/s^2", **scale}) for c in range(CHANNELS)])


def make_mat(path):
    """As MATLAB writes version 7.3: doubles, deflated in chunks."""
    import h5py
    x = signal(SECONDS)
    with h5py.File(path, "w", userblock_size=512) as file:
        for c in range(CHANNELS):
            file.create_dataset(f"acc_{c}", data=x[:, c:c + 1].T.astype(np.float64), chunks=(1, 16_384), compression="gzip", compression_opts=3)
        file["fs"] = np.array([[float(RATE_HZ)]])


def make_csv(path):
    x = signal(TABLE_SECONDS)
    with gzip.open(path, "wt", compresslevel=6) as file:
        file.write(",".join(f"acc_{c}" for c in range(CHANNELS)) + "\n")
        np.savetxt(file, x, fmt="%.5f", delimiter=",")


def read_tdms(path):
    from nptdms import TdmsFile
    return [channel[:] for group in TdmsFile.read(path).groups() for channel in group.channels()]


def read_mat(path):
    import h5py
    with h5py.File(path) as file:
        return [file[name][:] for name in file]


def read_csv(path):
    import pyarrow
    import pyarrow.csv
    with pyarrow.input_stream(str(path), compression="gzip") as file:
        return pyarrow.csv.read_csv(file, read_options=pyarrow.csv.ReadOptions(use_threads=False))


def read_mcap(path):
    from mcap.reader import make_reader
    with open(path, "rb") as file:
        return sum(len(message.data) for _, _, message in make_reader(file).iter_messages(log_time_order=False))


def installed(module):
    try:
        __import__(module)
        return True
    except ImportError:
        return False


def make(folder, figures):
    """Format, file, peer and its reading (absent where it is not installed); formats whose file cannot be made are left out."""
    found = []
    for name, file, peer, module, write, read in [
        ("TDMS (floats of 32 bits)", "floats.tdms", "npTDMS", "nptdms", make_tdms, read_tdms),
        ("TDMS (counts of 16 bits and a scale)", "counts.tdms", "npTDMS", "nptdms", make_tdms_counts, read_tdms),
        ("MAT 7.3", "samples.mat", "h5py", "h5py", make_mat, read_mat),
        ("CSV.gz", "samples.csv.gz", "pyarrow", "pyarrow", make_csv, read_csv),
    ]:
        path = folder / file
        here = installed(module)
        if not path.exists():
            if write not in (make_csv,) and not here:
                continue
            write(path)
        found.append((name, path, peer, (lambda read=read, path=path: read(path)) if here else None))
    packed = folder / "samples.mcap"
    if not packed.exists():
        figures("mcap", folder / "samples.mat", packed)
    found.append(("MCAP (zstd)", packed, "mcap without decoding", (lambda: read_mcap(packed)) if installed("mcap") else None))
    return found
