# SPDX-License-Identifier: MIT
"""Common part of the stand-in libraries: makes their classes, records the calls and raises errors at selected calls.

Tests in the same process use `calls`. For a bridge in another process, STAND_IN_LOG names the file for the calls.
STAND_IN_FAULTS=name:n,... selects the n-th call of each function. Settings of the cameras: STAND_IN_CAMERAS is the number of
cameras (default 1), and STAND_IN_LACKS=name,... lists the properties that they do not support. Pixel i of frame n has the
value 500 + (7 n + 3 i) % 5000, in depth units."""
import inspect
import json
import os
import re

import numpy as np

calls = []
_counts = {}


def setting(name, default=""):
    return os.environ.get(f"STAND_IN_{name}", default)


def lacks(name):
    return name in setting("LACKS").split(",")


def values(index, pixels):
    return (500 + (7 * index + 3 * np.arange(pixels)) % 5000).astype("<u2")


def reset():
    calls.clear()
    _counts.clear()


def called(name, *values):
    calls.append((name, *values))
    if path := setting("LOG"):
        with open(path, "a", encoding="utf-8") as log:
            log.write(json.dumps([name, *values]) + "\n")
    happen(name)


def happen(name):
    """Counts a call and raises the selected error. Does not record the call, because such calls may be frequent."""
    _counts[name] = _counts.get(name, 0) + 1
    if f"{name}:{_counts[name]}" in setting("FAULTS").split(","):
        raise RuntimeError(f"{name} failed")


def constant(value):
    return lambda self: value


def published(text):
    """Yields the class and the name of each function in a table of a vendor's functions, and the names of its arguments. A
    line begins with the class, or with "module". The vendor may publish only the number of arguments."""
    owner = ""
    for new_owner, name, words in re.findall(r"(\w+):|(\w+)\(([\w ]*)\)", text):
        owner = new_owner or owner
        if name:
            yield owner, name, [f"argument{k}" for k in range(int(words))] if words.isdigit() else words.split()


def complete(library, text):
    """Completes the namespace of a stand-in by the table of the vendor's functions. Each function refuses other arguments
    than the published ones. A method that the stand-in does not define only records its call."""
    for owner, name, arguments in published(text):
        if owner == "module":
            library[name] = with_arguments(library[name], arguments)
        else:
            place = library.setdefault(owner, type(owner, (), {}))
            setattr(place, name, with_arguments(vars(place).get(name) or recorded(name), ["self", *arguments]))


def recorded(name):
    return lambda self, *values: called(name, *values)


def with_arguments(function, names):
    signature = inspect.Signature([inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names])

    def checked(*values, **named):
        signature.bind_partial(*values, **named)
        return function(*values, **named)
    return checked
