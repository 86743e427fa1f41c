"""Recordings of commercial radars, written byte by byte from the formats' descriptions, and a line with reflectors."""

import struct

import numpy as np

# 5 GHz sampling; time zero at this sample
SAMPLES = 256
INTERVAL = 0.2e-9
ZERO = 20
NOMINAL = 500e6
STEP = 0.05
SEPARATION = 0.2
WINDOW = SAMPLES * INTERVAL * 1e9  # ns
SPEED = 1e8  # m/s in the ground
REFLECTORS = ((0.5, 0.4), (1.4, 0.8))  # along the line and below it, m


def delay_of(along):
    """Delays (trace, reflector) of the echoes, transmitter behind and receiver ahead of the trace's place."""
    x, depth = np.array(REFLECTORS).T
    ways = [np.hypot(along[:, None] + side * SEPARATION / 2 - x, depth) for side in (-1, 1)]
    return sum(ways) / SPEED


def section(count=40, scale=12000):
    """Counts (trace, sample) of a line over the reflectors: Ricker pulses at the nominal frequency."""
    time = (np.arange(SAMPLES) - ZERO) * INTERVAL
    late = time - delay_of(STEP * np.arange(count))[..., None]
    square = (np.pi * NOMINAL * late) ** 2
    return np.round(scale * ((1 - 2 * square) * np.exp(-square)).sum(axis=1)).astype(np.int32)


def gga(lat, lon, height, quality=4, clock="120000.00"):
    """NMEA's sentence of a position."""

    def cell(value, width):
        return f"{int(abs(value)):0{width}d}{(abs(value) % 1) * 60:010.7f}"

    sides = "N" if lat >= 0 else "S", "E" if lon >= 0 else "W"
    place = f"{cell(lat, 2)},{sides[0]},{cell(lon, 3)},{sides[1]}"
    return closed(f"$GPGGA,{clock},{place},{quality},9,0.9,{height:.3f},M,0.0,M,,")


def closed(sentence):
    """A sentence of NMEA with its checksum."""
    total = 0
    for letter in sentence[1:]:
        total ^= ord(letter)
    return f"{sentence}*{total:02X}"


def write_dt1(
    path, counts, real=False, order="<", comment=None, dead=None, hd=True, step=STEP, **entries
):
    data = b""
    for k, trace in enumerate(counts):
        head = np.zeros(25)
        head[[0, 1, 2, 5, 6, 7]] = k + 1, step * k, len(trace), 4 if real else 2, WINDOW, 8
        head[21] = k == dead
        head[23] = 36000 + k
        head[24] = k == comment
        data += head.astype(order + "f4").tobytes() + b"note".ljust(28, b"\0")
        data += trace.astype(order + ("f4" if real else "i2")).tobytes()
    path.write_bytes(data)
    told = {
        "NUMBER OF TRACES": len(counts), "NUMBER OF PTS/TRC": counts.shape[1], "TIMEZERO AT POINT": ZERO + 1,
        "TOTAL TIME WINDOW": f"{WINDOW:.6f}", "STARTING POSITION": 0, "FINAL POSITION": step * (len(counts) - 1),
        "STEP SIZE USED": step, "POSITION UNITS": "m", "NOMINAL FREQUENCY": NOMINAL / 1e6,
        "ANTENNA SEPARATION": SEPARATION, "DATA TYPE": "F*4" if real else "I*2",
    }  # fmt: skip
    told |= {name.replace("_", " "): value for name, value in entries.items()}
    lines = [
        "1234",
        "line - pulseEKKO",
        "2024-Apr-04",
        *(f"{name:<19}= {value}" for name, value in told.items()),
    ]
    if hd:
        path.with_suffix(".hd").write_bytes("\r\n".join(lines).encode())
    return path


def write_dzt(path, channels, bits=16, names=("50400",), per_metre=1 / STEP, data=None):
    """Channels (trace, channel, sample) of signed counts; the first two samples give way to scan number and marks."""
    many, samples = channels.shape[1:]
    head = bytearray(1024 * many)
    for k in range(many):
        start = many if data is None else data
        struct.pack_into("<HHHHh", head, 1024 * k, 0x00FF, start, samples, bits, 0)
        struct.pack_into(
            "<5f", head, 1024 * k + 10, 50.0, per_metre, 5.0, -ZERO * INTERVAL * 1e9, WINDOW
        )
        struct.pack_into("<H", head, 1024 * k + 52, many)
        name = names[k].encode()
        head[1024 * k + 98 : 1024 * k + 98 + len(name)] = name
    kind, offset = {8: ("u1", 128), 16: ("<u2", 32768), 32: ("<i4", 0)}[bits]
    raw = (channels.astype(np.int64) + offset).astype(kind)
    raw[..., 0] = np.arange(len(raw))[:, None] % 200
    raw[..., 1] = 7
    raw[5, :, 1] = 9
    path.write_bytes(bytes(head) + raw.tobytes())
    return path


def write_mala(path, counts, rad=True, **entries):
    path.write_bytes(counts.astype("<i4" if path.suffix.lower() == ".rd7" else "<i2").tobytes())
    told = {
        "SAMPLES": counts.shape[1], "FREQUENCY": 1e-6 / INTERVAL, "DISTANCE FLAG": 1, "TIME INTERVAL": 0.1,
        "DISTANCE INTERVAL": STEP, "SITE": "meadow", "ANTENNAS": "500 MHz shielded", "ANTENNA SEPARATION": SEPARATION,
        "TIMEWINDOW": WINDOW, "LAST TRACE": len(counts),
    } | {name.replace("_", " "): value for name, value in entries.items()}  # fmt: skip
    if rad:
        path.with_suffix(".RAD").write_text(
            "\r\n".join(f"{name}:{value}" for name, value in told.items())
        )
    return path


def write_impulse(path, counts, bits=16, **entries):
    path.write_bytes(counts.astype(f"<i{bits // 8}").tobytes())
    told = {
        "HEADER VERSION": 20, "DATA VERSION": bits, "ANTENNA": "500 MHz", "ANTENNA SEPARATION": SEPARATION,
        "SAMPLES": counts.shape[1], "FREQUENCY": 1e-6 / INTERVAL, "LAST TRACE": len(counts), "TRIG SOURCE": "wheel",
        "DISTANCE INTERVAL": STEP, "ZERO LEVEL": ZERO,
    } | {name.replace("_", " "): value for name, value in entries.items()}  # fmt: skip
    path.with_suffix(".iprh").write_text(
        "\n".join(f"{name}: {value}" for name, value in told.items())
    )
    return path


def write_ids(path, counts, size=None, unsigned=0, lost=None, **entries):
    """Records of one length: V, the header's (I, ATR, H), then one per trace that begins with R."""
    samples = counts.shape[1]
    size = size or 4 + 2 * samples
    told = {
        "window": WINDOW * 1e-9,
        "samples": samples,
        "traces": len(counts),
        "apart": SEPARATION,
    } | entries

    def record(name, body):
        return (name.ljust(4, b"\0") + body).ljust(size, b"\0")

    def text(*values):
        return b"".join(f"{value:.6E}".encode().ljust(16, b"\0") for value in values)

    counted = struct.pack(
        "<11i", size, 1, samples, told["traces"], told["samples"], 0, 1, 1, 1, 1, unsigned
    )
    measured = text(4e5, 1e8, 1e-3, told["window"], 500, 1e-3, STEP, 0.01, 0.01, 0.01)
    antennas = text(0, 0, 0) + b"500\0\0" + text(0, told["apart"], 0) + b"500\0\0"
    data = (b"V\4\0\0" + struct.pack("<H", size)).ljust(size, b"\0")
    data += record(b"I", b"meadow") + record(b"ATR", antennas) + record(b"H", counted + measured)
    for k, trace in enumerate(counts):
        values = (trace + unsigned).astype("<u2" if unsigned else "<i2").tobytes()
        mark = b"R\1\6\0" if k == lost else b"R\10\0\0" if k == 7 else b"R\0\0\0"
        data += (mark + values).ljust(size, b"\0")
    path.write_bytes(data)
    return path


def ibm(value):
    """IBM's floating point of one number: sign, exponent of 16 less 64, 24 bits of fraction."""
    if value == 0:
        return 0
    exponent = 0
    size = abs(value)
    while size >= 1:
        size = size / 16
        exponent = exponent + 1
    while size < 1 / 16:
        size = size * 16
        exponent = exponent - 1
    return (int(value < 0) << 31) | ((exponent + 64) << 24) | round(size * 2**24)


def write_segy(path, counts, code=3, order=">", unit=1, scalar=-100, place=None, interval=None):
    head = bytearray(3600)
    picoseconds = round(INTERVAL * 1e12) if interval is None else interval
    struct.pack_into(order + "H", head, 3216, picoseconds)
    struct.pack_into(order + "H", head, 3220, counts.shape[1])
    struct.pack_into(order + "H", head, 3224, code)
    data = bytes(head)
    for k, trace in enumerate(counts):
        x, y = (round(100 * STEP * k), 0) if place is None else place[k]
        one = bytearray(240)
        struct.pack_into(order + "i", one, 0, k + 1)
        struct.pack_into(order + "hii", one, 70, scalar, x, y)
        struct.pack_into(order + "h", one, 88, unit)
        if code == 1:
            values = np.array([ibm(float(value)) for value in trace], dtype=order + "u4")
        else:
            values = trace.astype(order + {2: "i4", 3: "i2", 5: "f4", 8: "i1"}[code])
        data += bytes(one) + values.tobytes()
    path.write_bytes(data)
    return path
