"""What the live page says to the planner, and where that waits to be taken."""

from __future__ import annotations

import json
import threading
from typing import Any

from pydantic import Field, NonNegativeInt, model_validator

from .._support.toml_files import Pair, Positive, Strict, Text, Vec3, validated
from ..errors import InputError


class Drag(Strict):
    """A handle that is moved."""

    name: Text = Field(description="name of the handle")
    position: Vec3 = Field(description="where it shall be, m")
    done: bool = Field(description="whether it was let go")


class Bound(Strict):
    """Bounds of some muscles."""

    muscles: Text = Field(description="a name or pattern, such as R1-dl or *3-dl")
    activation: Pair = Field(description="lower and upper bound")


class Speed(Strict):
    """A limit on changes of all activations."""

    largest: Positive | None = Field(description="1/s; none for what the problem file says")


class Message(Strict):
    """One change, with the number that its answer will have."""

    n: NonNegativeInt
    drag: Drag | None = None
    bound: Bound | None = None
    speed: Speed | None = None
    reset: bool = False

    @model_validator(mode="after")
    def _one_change(self) -> Message:
        changes = [part for part in (self.drag, self.bound, self.speed) if part is not None]
        if len(changes) + self.reset != 1:
            raise ValueError("expected one of drag, bound, speed and reset")
        return self

    @property
    def done(self) -> bool:
        """Whether the plan shall be finished and checked."""
        return self.drag is None or self.drag.done

    @property
    def subject(self) -> str:
        """What it changes: of waiting messages on one subject, the newest counts."""
        if self.drag is not None:
            return f"drag {self.drag.name}"
        if self.bound is not None:
            return f"bound {self.bound.muscles}"
        return "speed" if self.speed is not None else "reset"


def parsed(text: str | bytes) -> Message:
    """A message from its JSON.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        content: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"message: is not JSON ({type(error).__name__}).") from None
    if not isinstance(content, dict):
        raise InputError("message: expected a JSON object.")
    return validated(content, Message, "message")


class Inbox:
    """Messages that wait for the planner, which may be in another thread than those who put them.

    Attributes
    ----------
    closed : bool
        Whether the conversation has ended.
    """

    MOST = 100  # subjects that may wait

    def __init__(self) -> None:
        self.closed = False
        self._changed = threading.Condition()
        self._messages: dict[str, Message] = {}

    @property
    def waiting(self) -> bool:
        """Whether the planner should come back soon."""
        return bool(self._messages) or self.closed

    def wait(self, seconds: float) -> bool:
        """Wait so long for a message; returns whether there is one."""
        with self._changed:
            return self._changed.wait_for(lambda: self.waiting, seconds)

    def put(self, message: Message) -> None:
        """Add a message; it replaces one on the same subject, and `reset` replaces all.

        Raises
        ------
        InputError
            If too many different ones wait.
        """
        with self._changed:
            if message.reset:
                self._messages.clear()
            self._messages.pop(message.subject, None)
            if len(self._messages) >= self.MOST:
                raise InputError(f"message: {self.MOST} others wait; expected fewer at a time.")
            self._messages[message.subject] = message
            self._changed.notify_all()

    def take(self) -> list[Message]:
        """All messages, in order; waits for one. Empty once the conversation has ended."""
        with self._changed:
            self._changed.wait_for(lambda: self.waiting)
            messages = [] if self.closed else [*self._messages.values()]
            self._messages.clear()
            return messages

    def close(self) -> None:
        """End the conversation."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()
