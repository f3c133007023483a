"""Recordings of every kind, and those that are odd or no use."""

import numpy as np
import pytest
import soundfile
from sounds import DENSITY_V, pulses_at

from trackerlib.receiver.recording import Recording
from trackerlib.receiver.report_receiver import FULL_SCALE_V
from trackerlib.simulation.sound import SimulatedSound, write_sound
from trackerlib.textfiles import InputError

RATE = 24_000
TONE = (0.5 * np.sin(2 * np.pi * 0.2 * np.arange(2 * RATE))).astype(np.float32)


def read(path, channel=None, seconds=0.25):
    """Samples and notes of a recording."""
    with Recording(path, channel) as recording:
        sound = np.concatenate([np.empty(0, np.float32), *recording.blocks(seconds)])
        recording.check()
        return sound, " | ".join(recording.notes())


@pytest.mark.parametrize(
    ("layout", "subtype"),
    [
        ("WAV", "PCM_16"),
        ("WAV", "PCM_24"),
        ("WAV", "FLOAT"),
        ("RF64", "PCM_24"),
        ("FLAC", "PCM_16"),
        ("FLAC", "PCM_24"),
    ],
)
def test_every_layout_gives_the_same_sound(tmp_path, layout, subtype):
    path = tmp_path / "sound"
    soundfile.write(path, TONE, RATE, format=layout, subtype=subtype)
    sound, notes = read(path)
    assert np.abs(sound - TONE).max() < (4e-5 if subtype == "PCM_16" else 2e-7)
    assert "truncated" not in notes
    assert "clipped" not in notes
    assert f"{RATE} samples per second, 2.000 s" in notes


def test_a_simulated_recording_says_so(tmp_path):
    path = tmp_path / "simulated.wav"
    write_sound(path, SimulatedSound(pulses_at([0.2]), DENSITY_V, RATE, FULL_SCALE_V, 1), 1.5)
    with Recording(path) as recording:
        assert recording.simulated
        assert sum(len(block) for block in recording.blocks()) == 1.5 * RATE


def test_of_two_channels_one_is_chosen_and_that_is_said(tmp_path):
    path = tmp_path / "stereo.wav"
    soundfile.write(path, np.stack([0 * TONE, TONE], axis=1), RATE)
    with pytest.raises(InputError, match="channel 1 is 0; channel 2 has sound"):
        read(path)
    sound, notes = read(path, channel=2)
    assert np.abs(sound - TONE).max() < 4e-5
    assert "2 channels; heard channel 2" in notes
    with pytest.raises(InputError, match="found 2 channels, wanted number 3"):
        read(path, channel=3)


def test_a_clipped_recording_is_read_and_named(tmp_path):
    path = tmp_path / "clipped.wav"
    soundfile.write(path, np.clip(3 * TONE, -1, 1), RATE)
    sound, notes = read(path)
    assert len(sound) == len(TONE)
    assert "lie at full scale: the recording is clipped" in notes


@pytest.mark.parametrize(("layout", "subtype"), [("WAV", "PCM_16"), ("RF64", "PCM_24"), ("FLAC", "PCM_16")])
def test_a_truncated_recording_is_read_as_far_as_it_goes(tmp_path, layout, subtype):
    path = tmp_path / "cut"
    soundfile.write(path, np.tile(TONE, 4), RATE, format=layout, subtype=subtype)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 5 // 8])
    sound, notes = read(path)
    assert 0.4 * 8 < len(sound) / RATE < 0.65 * 8
    assert np.abs(sound - np.tile(TONE, 4)[: len(sound)]).max() < 4e-5
    assert "truncated" in notes
    assert "8.000 s" in notes


def test_a_head_that_was_never_finished(tmp_path):
    # A recorder that loses power leaves the size at its greatest, or at nought.
    path = tmp_path / "unfinished.wav"
    soundfile.write(path, TONE, RATE)
    content = bytearray(path.read_bytes())
    place = content.index(b"data") + 4
    content[place : place + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(content)
    sound, notes = read(path)
    assert len(sound) == len(TONE)
    assert "truncated" not in notes
    content[place : place + 4] = b"\0\0\0\0"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"found no samples in 96044 bytes.* head is whole"):
        read(path)


def test_values_that_are_no_numbers_are_silence_and_counted(tmp_path):
    path = tmp_path / "odd.wav"
    odd = TONE.copy()
    odd[100:103] = np.nan, np.inf, -np.inf
    soundfile.write(path, odd, RATE, subtype="FLOAT")
    sound, notes = read(path)
    assert np.all(sound[100:103] == 0)
    assert "3 samples are not numbers" in notes


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (b"", "found no recording of sound"),
        (b"RIFFxxxx", "found no recording of sound"),
        (b"period,rank\n1,1\n" * 100, "found no recording of sound"),
        (None, "no such file"),
    ],
)
def test_what_is_no_sound_is_refused(tmp_path, content, wanted):
    path = tmp_path / "not.wav"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=wanted):
        read(path)
    with pytest.raises(InputError, match="found a folder"):
        read(tmp_path)


def test_silence_and_no_samples_are_refused(tmp_path):
    path = tmp_path / "silent.wav"
    soundfile.write(path, 0 * TONE, RATE)
    with pytest.raises(InputError, match="found silence, every one of 48000 samples"):
        read(path)
    soundfile.write(path, TONE[:0], RATE)
    with pytest.raises(InputError, match="found no samples in"):
        read(path)


def test_a_file_that_may_not_be_read_is_told(tmp_path, monkeypatch):
    path = tmp_path / "mine.wav"
    soundfile.write(path, TONE, RATE)

    def forbidden(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", forbidden)  # the tests may run as root, who may read everything
    with pytest.raises(InputError, match=r"mine.wav: cannot be read \(Permission denied\)"):
        Recording(path)
