"""Recordings of sound, read block by block: WAV, RF64, FLAC and whatever else libsndfile knows, of any length.

A recording that is odd is read as far as it goes, and what was odd is said in sentences (`Recording.notes`). One
that is no use raises InputError.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import soundfile

from trackerlib.receiver.recording_start import recording_began
from trackerlib.textfiles import InputError

BLOCK_S = 1.0  # read at a time
MOST_FRAMES = 2**31  # libsndfile's word for a length that it does not know is above this
CLIPPED_SAMPLES = 3  # so many at full scale are no accident
SIMULATED = "SIMULATED"  # comment of a file that says so


class Recording:
    """One channel of a sound file; samples are within -1 and 1 whatever the bits.

    channel : from 1; None takes the first and says so where there are more
    Raises InputError for a file that is missing, no sound, or has no such channel.
    """

    def __init__(self, path: str | Path, channel: int | None = None):
        self.path = Path(path)
        if self.path.is_dir():
            raise InputError(f"{self.path}: found a folder, wanted a recording")
        if not self.path.exists():
            raise InputError(f"{self.path}: no such file")
        try:
            self.path.open("rb").close()  # libsndfile's own word for a file it may not read is "System error"
            self._file = soundfile.SoundFile(self.path)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror})") from None
        except soundfile.LibsndfileError as error:
            raise InputError(
                f"{self.path}: found no recording of sound ({error.error_string.strip()}); wanted WAV, RF64 or FLAC"
            ) from None
        self.rate_hz: int = self._file.samplerate
        self.channels: int = self._file.channels
        self.layout = f"{self._file.format}, {self._file.subtype}"
        self.simulated = SIMULATED in (self._file.comment, self._file.title)
        self.began = recording_began(self.path, self._file.date)  # [s since 1970], and what tells it; or None
        self.channel = self._choose(channel)
        self.promised = self._promised()  # samples that the file's head tells of
        self.samples_read, self.loudest = 0, np.zeros(self.channels)
        self._clipped, self._strange, self._broken = 0, 0, ""

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_) -> None:
        self._file.close()

    @property
    def seconds(self) -> float:
        """Length, as far as it has been read."""
        return self.samples_read / self.rate_hz

    def blocks(self, seconds: float = BLOCK_S) -> Iterator[np.ndarray]:
        """The channel's samples from where reading stands, block by block (K,) float32."""
        count = max(int(seconds * self.rate_hz), 1)
        full = 1 - 2.0 ** (1 - _bits(self._file.subtype))
        while True:
            try:
                frames = self._file.read(count, dtype="float32", always_2d=True)
            except soundfile.LibsndfileError as error:
                self._broken = error.error_string.strip()
                return
            if not len(frames):
                return
            self.samples_read += len(frames)
            sound = np.ascontiguousarray(frames[:, self.channel - 1])
            size = np.abs(frames)
            if not np.isfinite(size.sum()):
                self._strange += int(np.sum(~np.isfinite(sound)))
                sound, size = (
                    np.nan_to_num(sound, posinf=0, neginf=0),
                    np.nan_to_num(size, posinf=0, neginf=0),
                )
            self.loudest = np.maximum(self.loudest, size.max(axis=0))
            if self.loudest[self.channel - 1] >= full:
                self._clipped += int(np.count_nonzero(size[:, self.channel - 1] >= full))
            yield sound

    def check(self) -> None:
        """Raises InputError if what was read holds no sound at all."""
        if not self.samples_read:
            size = self.path.stat().st_size
            raise InputError(
                f"{self.path}: found no samples in {size} bytes, wanted a recording whose head is whole"
            )
        if self.loudest[self.channel - 1] > 0:
            return
        others = [f"{k + 1}" for k in np.flatnonzero(self.loudest > 0)]
        hint = f"; channel {' and '.join(others)} has sound" if others else ""
        raise InputError(
            f"{self.path}: found silence, every one of {self.samples_read} samples of channel {self.channel} is 0{hint}"
        )

    def notes(self) -> list[str]:
        """What a person should know of this recording, as far as it has been read."""
        notes = [f"{self.layout}, {self.rate_hz} samples per second, {self.seconds:.3f} s"]
        if self.channels > 1:
            notes.append(f"{self.channels} channels; heard channel {self.channel}")
        if self._clipped >= CLIPPED_SAMPLES:
            share = 100 * self._clipped / self.samples_read
            notes.append(
                f"{self._clipped} samples ({share:.2g} %) lie at full scale: the recording is clipped, times suffer"
            )
        if self._strange:
            notes.append(f"{self._strange} samples are not numbers and were taken as silence")
        if self._broken or self.promised > self.samples_read:
            why = f" ({self._broken})" if self._broken else ""
            notes.append(
                f"truncated{why}: its head tells of {self.promised / self.rate_hz:.3f} s, "
                f"{self.seconds:.3f} s are there"
            )
        return notes

    def _choose(self, channel: int | None) -> int:
        if channel is None:
            return 1
        if not 1 <= channel <= self.channels:
            raise InputError(f"{self.path}: found {self.channels} channels, wanted number {channel}")
        return channel

    def _promised(self) -> int:
        """Samples that the file should hold; libsndfile itself cuts the number of a WAV to what is there."""
        size = _data_bytes(self.path)
        frame = self.channels * _bits(self._file.subtype) // 8
        if size and self._file.subtype.startswith(("PCM", "FLOAT", "DOUBLE")):
            return size // frame
        return self._file.frames if self._file.frames < MOST_FRAMES else 0


def _bits(subtype: str) -> int:
    """Bits of a sample; 24, what float32 resolves, where that is not in the name."""
    known = {"PCM_S8": 8, "PCM_U8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32, "FLOAT": 32, "DOUBLE": 64}
    return known.get(subtype, 24)


def _data_bytes(path: Path) -> int:
    """Size of the data chunk as the head of a WAV or RF64 file tells it; 0 if it does not, or is another kind."""
    with path.open("rb") as file:
        kind, _, form = struct.unpack("<4sI4s", file.read(12).ljust(12, b"\0"))
        if kind not in (b"RIFF", b"RF64") or form != b"WAVE":
            return 0
        long_size = 0
        while len(head := file.read(8)) == 8:
            name, size = struct.unpack("<4sI", head)
            if name == b"ds64":
                _, long_size = struct.unpack("<QQ", file.read(16))
                size -= 16
            elif name == b"data":
                return long_size or (size if size != 0xFFFFFFFF else 0)
            file.seek(size + size % 2, 1)
    return 0
