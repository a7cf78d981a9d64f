#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Counts words that plain technical English avoids (.github/CONTRIBUTING.md), and counts long sentences.

The words are counted in the strings, comments and manuals of each folder. Sentences longer than 25 words are counted in
manuals only. The limits may be lowered but not raised. `english.py --list` prints the location of each finding."""
import io
import pathlib
import re
import sys
import tokenize

root = pathlib.Path(__file__).resolve().parent.parent
avoided = re.compile(
    r"\b(nobody|somebody|whoever|anew|whose|beside|told|tells|so many|(?<!times )as many|meanwhile|is none|"
    r"is no|of which|what is|goes by|bears|stands(?! for\b| still\b| in front\b| \d))\b", re.I)
LIMITS = {".github": 0, "README.md": 0, "acquire": 0, "config": 0, "drivers": 0, "recon": 2, "scripts": 0, "sim": 0,
          "tests": 8}
LONG_SENTENCES = 36
words_limit = 25


def of_cpp(text):
    """Yields the line number and the content of each comment and string literal."""
    token = re.compile(r'//[^\n]*|/\*.*?\*/|R"\((.*?)\)"|"(?:\\.|[^"\\\n])*"', re.S)
    for match in token.finditer(text):
        yield text.count("\n", 0, match.start()) + 1, match[0]


def of_python(text):
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield token.start[0], token.string


def of_manual(text):
    """Yields the line number and the content of each line of a manual, leaving out code blocks. Inline code is
    replaced with `x`."""
    text = re.sub(r"^```.*?^```$", lambda block: "\n" * block[0].count("\n"), text, flags=re.M | re.S)
    for number, line in enumerate(text.splitlines(), 1):
        yield number, re.sub(r"`[^`]*`", "`x`", line)


def long_sentences(text):
    text = re.sub(r"^(```.*?^```|\|[^\n]*|#[^\n]*|<!--.*?-->)$", "", text, flags=re.M | re.S)
    for paragraph in re.split(r"\n\s*\n|\n *[-*] |\n *\d+\. ", text):
        for sentence in re.split(r"(?<=[.!?])\s+(?=[A-Z`*\[])", " ".join(paragraph.split())):
            if len(sentence.split()) > words_limit:
                yield sentence


found = {folder: [] for folder in LIMITS}
long = []
for folder in LIMITS:
    place = root / folder
    for path in [place] if place.is_file() else sorted(place.rglob("*")):
        name = path.relative_to(root)
        if not path.is_file() or {"__pycache__", "corpus", "golden"} & set(path.parts) or path.name == "english.py":
            continue
        if path.suffix in (".cpp", ".hpp", ".js"):
            parts = of_cpp(path.read_text(encoding="utf-8"))
        elif path.suffix == ".py":
            parts = of_python(path.read_text(encoding="utf-8"))
        elif path.suffix == ".md":
            text = path.read_text(encoding="utf-8")
            parts = of_manual(text)
            if path.name != "CHANGELOG.md":
                long += [f"{name}: {sentence}" for sentence in long_sentences(text)]
        else:
            continue
        for line, words in parts:
            found[folder] += [f"{name}:{line}: {match[0]}" for match in avoided.finditer(words)]

if "--list" in sys.argv:
    print("\n".join([place for places in found.values() for place in places] + long))
faults = [f"{folder}: {len(places)} words that plain technical English avoids; at most {LIMITS[folder]} may stay"
          for folder, places in found.items() if len(places) > LIMITS[folder]]
if len(long) > LONG_SENTENCES:
    faults.append(f"manuals: {len(long)} sentences of more than {words_limit} words; at most {LONG_SENTENCES} may stay")
print("\n".join([*faults, "tests/english.py --list prints the places"]) if faults else "no new word to avoid")
sys.exit(bool(faults))
