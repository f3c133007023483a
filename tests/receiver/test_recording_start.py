"""When a recording began: its head, its bext chunk, its name."""

import struct

import numpy as np
import pytest
import soundfile

from trackerlib.receiver.recording import Recording
from trackerlib.receiver.recording_start import instant_in

NOON_S = 1_714_566_896.0  # 2024-05-01 12:34:56 UTC


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("SM3_20240501_123456", NOON_S),
        ("2024-05-01T12:34:56.250Z", NOON_S + 0.25),
        ("pam 2024-05-01 12-34-56", NOON_S),
        ("20240501T123456Z", NOON_S),
        ("1234567890123456", None),
        ("20241301_123456", None),
        ("hunt 3", None),
        ("20240501", None),
    ],
)
def test_instants_in_texts(text, seconds):
    assert instant_in(text) == seconds


def test_a_head_counts_before_a_name(tmp_path):
    path = tmp_path / "20240501_123456.flac"
    with soundfile.SoundFile(path, "w", 8000, channels=1) as file:
        file.write(np.ones(100) / 2)
    assert Recording(path).began == (NOON_S, "name")
    with soundfile.SoundFile(path, "w", 8000, channels=1) as file:
        file.date = "2024-05-01T12:34:57Z"
        file.write(np.ones(100) / 2)
    assert Recording(path).began == (NOON_S + 1, "head")


def test_a_broadcast_wav_says_when(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, np.ones(100) / 2, 8000)
    assert Recording(path).began is None
    whole = path.read_bytes()
    chunk = bytes(320) + b"2024-05-0112:34:56" + bytes(264)
    body = whole[:12] + b"bext" + struct.pack("<I", len(chunk)) + chunk + whole[12:]
    path.write_bytes(body[:4] + struct.pack("<I", len(body) - 8) + body[8:])
    assert Recording(path).began == (NOON_S, "head")
