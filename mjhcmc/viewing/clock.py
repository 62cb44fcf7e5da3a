"""What time a replay shows: real time or slower, paused, stepped, moved."""

from __future__ import annotations

_FASTER = 2.0  # by which each press changes the speed
_SPEEDS = (1 / 64, 16.0)

_SPACE, _MINUS, _EQUAL, _LEFT_BRACKET, _RIGHT_BRACKET = (ord(key) for key in " -=[]")
_RIGHT, _LEFT, _HOME, _END = 262, 263, 268, 269  # as GLFW counts keys

HELP = (
    ("space", "pause"),
    ("left, right", "one control window"),
    ("[  ]", "slower, faster"),
    ("Home, End", "begin, end"),
    ("drag", "time, in the panel Control"),
)
"""What each key does, for people."""


class Clock:
    """The time that a replay shows.

    Args:
        first: s, where it begins.
        last: s, where it ends.
        speed: seconds shown in each second that passes.
        step: s, by which single steps go.
        loop: whether it begins again at the end; it stops there where not.

    Attributes:
        time: s.
        speed: as it was set last.
        playing: False while paused.
    """

    def __init__(self, first: float, last: float, *, speed: float = 1.0, step: float = 0.01, loop: bool = True) -> None:
        self.time, self.speed, self.playing = first, speed, True
        self._first, self._last, self._step, self._loop = first, last, step, loop

    def advance(self, seconds: float) -> None:
        """Let time pass, s, unless paused."""
        if not self.playing:
            return
        self.time += self.speed * seconds
        if self.time <= self._last:
            return
        length = self._last - self._first
        if self._loop and length > 0:
            self.time = self._first + (self.time - self._first) % length
        else:
            self.time, self.playing = self._last, False

    def seek(self, time: float) -> None:
        """Go to a time, s, and stay there."""
        self.time, self.playing = min(max(time, self._first), self._last), False

    def press(self, key: int) -> bool:
        """Do what a key (as GLFW counts them) stands for; False where it stands for nothing."""
        if key == _SPACE:
            if not self.playing and self.time >= self._last:
                self.time = self._first
            self.playing = not self.playing
        elif key in (_LEFT, _RIGHT):
            self.seek(self.time + (self._step if key == _RIGHT else -self._step))
        elif key in (_HOME, _END):
            self.seek(self._first if key == _HOME else self._last)
        elif key in (_MINUS, _LEFT_BRACKET, _EQUAL, _RIGHT_BRACKET):
            slower = key in (_MINUS, _LEFT_BRACKET)
            self.speed = min(max(self.speed / _FASTER if slower else self.speed * _FASTER, _SPEEDS[0]), _SPEEDS[1])
        else:
            return False
        return True
