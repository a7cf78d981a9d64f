#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the rules of this repository.

Each file has an SPDX line and at most 500 lines. C++ files have the layout that clang-format 14 produces (not checked if
clang-format 14 is not installed). Type names are unique, and includes and imports are not circular. Commands, options, files
and headings named in manuals exist, and so do test cases named in CMake files."""
import ast
import fnmatch
import pathlib
import re
import shutil
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parent.parent
faults = []
tracked = sorted(path for folder in ("drivers", "acquire", "recon", "sim", "config", "scripts", "tests")
                 for path in (root / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
# Texts of the source files, by their names.
sources = {str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in tracked
           if path.suffix in (".cpp", ".hpp", ".py", ".sh") or path.name == "CMakeLists.txt"
           or path.parent.name == "scripts" and not path.suffix}
cpp = {name: text for name, text in sources.items() if name.endswith((".cpp", ".hpp"))}
product = {name: re.sub(r"//.*", "", text) for name, text in cpp.items()
           if not name.startswith(("tests/", "recon/api/", "recon/include/"))}


def places(name, matches):
    """Returns the places NAME:LINE of the lines for which matches(line) is true."""
    return [f"{name}:{number}" for number, line in enumerate(sources[name].splitlines(), 1) if matches(line)]


# Comments should begin with a verb or a noun (.github/CONTRIBUTING.md).
vague = re.compile(r"(It|They|This|These|Of|What|Where|Whoever|Whose)\b", re.I)
types = {}  # maps the full name of a type to the files that define the type
for name, text in sources.items():
    lines = text.splitlines()
    if not any("SPDX-License-Identifier: MIT" in line for line in lines[:2]):
        faults.append(f"{name}: no SPDX line in the first two")
    if len(lines) > 500:
        faults.append(f"{name}: {len(lines)} lines; at most 500")
    if name.startswith("recon/python"):
        faults += [f"{place}: more than 100 characters" for place in places(name, lambda line: len(line) > 100)]
        docstrings = re.findall(r'"""(.+)', text)
        faults += [f"{name}: the docstring {said!r} begins with a vague word" for said in docstrings if vague.match(said)]
for name, text in cpp.items():
    lines, namespaces = text.splitlines(), []
    for number, line in enumerate(lines):
        if opened := re.match(r"(?:inline )?namespace ?([\w:]*) \{(?!.*\})", line):
            if lines[number + 2] != "}":  # clang-format adds closing comments only to namespaces that are long enough
                namespaces.append(opened[1])
        elif re.match(r"\}  // namespace", line) and namespaces:
            namespaces.pop()
        elif defined := re.match(r"(?:template <.*> )?(?:struct|class|union|enum|enum class) (?:\[\[\w+\]\] )?"
                                 r"([\w<>, ]+?)(?: final)?(?: : .*[^;]| \{.*)$", line):
            if "" not in namespaces:
                types.setdefault("::".join([*namespaces, defined[1]]), set()).add(name)
        code, slashes, comment = re.sub(r'"(\\.|[^"\\])*"', '""', line).partition("//")
        goes_on = not code.strip() and number > 1 and lines[number - 1].lstrip().startswith("//")
        if slashes and not goes_on and vague.match(comment.lstrip("/< ")):
            faults.append(f"{name}:{number + 1}: the comment begins with a vague word")
    if namespaces:
        faults.append(f"{name}: no `}}  // namespace` ends {namespaces[-1]}")
# If two types had the same name, the linker would merge their inline functions without a warning.
faults += [f"{name} is defined in {' and '.join(sorted(files))}" for name, files in types.items() if len(files) > 1]
# CMake would split a test name at a ";", and Catch would interpret a leading "-" as an option.
cases = ["".join(re.findall(r'"(.*?)"', name))
         for text in cpp.values() for name in re.findall(r'TEST_CASE\(\s*((?:"[^"]*"\s*)+)', text)]
faults += [f"the name of the test case {case!r} has a ; or begins with -" for case in cases if re.match("-|.*;", case)]
# Most test cases named in CMake lists are slow and rarely run, so a wrong name would not be noticed soon.
faults += [f"{path}: no test case is named {name}" for path, text in sources.items() if path.endswith("CMakeLists.txt")
           for names in re.findall(r'\${no_tests_fail} "([^-"][^"]*)"', text) for name in names.split(",")
           if not fnmatch.filter(cases, name)]

# Optional parts: ARCHITECTURE.md limits the number of product source files outside a part that use its identifiers. Each
# entry contains a pattern for identifiers and a pattern for the part's own files. The public interface is not counted,
# because its purpose is to name every part.
wings = {
    "response": (r"(radar|any|stated|widest|to)_response|RadarResponse|record::Response\b|response_(of|keys|filter|fit)",
                 r"/response"),
    "empty room": (r"empty_room|EmptyRoom|--empty", r"/empty_room\.|^sim/"),
    "verdict": (r"[Vv]erdict", r"/verdicts?\."),
    "zones": (r"[Zz]one|histograms_of", r"/zone(_fields)?\."),
    "calibration": (r"[Cc]alibrat", r"/calibrat"),
    "antennas": (r"[Aa]ntenna|RadarArray|radar_array", r"array|antenna"),
    "trust": (r"[Oo]ut_?[Oo]f_?[Dd]istribution|[Dd]omain_?[Ss]hift|[Uu]ncertainty|[Pp]ixel_?[Ee]rror", r"^recon/trust/"),
    "fine-tuning": (r"[Cc]ross_?[Vv]alid|\btune|Tun(ed|ing)", r"/(tune|crossvalidate|choice)\."),
    "pile-up": (r"pile_up|dead_time|first_photon", r"/pile_up\."),
    "letters": (r"[Ll]etter", r"letter"),
    "raw capture": (r"raw_tap|RawTap|keep_raw", r"/raw_tap\."),
    "TI's codes": (r"log2_(q8|codes|power_step)|power_from_code", r"^(drivers|sim)/"),
    "twin": (r"[Tt]win", r"^sim/twin/"),
    "multipath": (r"[Mm]ultipath", r"/multipath_"),
    "meshes": (r"\b[Mm]esh|_mesh", r"/mesh\.")}
core, optional = (root / ".github/ARCHITECTURE.md").read_text(encoding="utf-8").split("\n## ")[1:3]
limits = {wing: int(limit) for wing, limit in re.findall(r"^\| ([^|]+) \|.*\| (\d+) \|$", optional, re.M)}
if limits.keys() != wings.keys():
    faults.append(f"ARCHITECTURE.md: the wings {', '.join(limits)} differ from those in tests/lint.py")
for wing, (identifier, own) in wings.items():
    named = [name for name, code in product.items() if not re.search(own, name) and re.search(identifier, code)]
    if len(named) > (limit := limits.get(wing, 0)):
        faults.append(f"{wing} is named in {len(named)} files outside its own, at most {limit} may: {', '.join(named)}")
headers = set()
for folder, names in re.findall(r"^\| `([\w/]+)` \| (.*?) \|", core, re.M):
    listed = {f"{folder}/{name}.hpp" for name in re.findall(r"`(\w+)`", names)}
    faults += [f"ARCHITECTURE.md: {name} does not exist" for name in sorted(listed - product.keys())]
    headers |= listed | {name for name in product if "the rest" in names and re.fullmatch(rf"{folder}/\w+\.hpp", name)}
if f"read the {len(headers)} headers" not in core:
    faults.append(f"ARCHITECTURE.md: the core has {len(headers)} headers; the text states another number")

# Tests write runs with tests/fixtures, so that a change of the run format changes only the fixtures. This counts the lines
# outside of the fixtures that construct a writer, define the axes, zones, antennas or calibration of a run, or contain SQL
# that changes a database. The remaining lines test the writer, or damage a file in a way that no other test needs.
by_hand = re.compile(r"RunWriter [a-z]\w*\(|RunWriter[>\w]*\(\w|put_(axis|zones|antennas|calibration)\(|INSERT (OR \w+ )?INTO|DELETE FROM"
                     r"|UPDATE \w+ SET|(ALTER|CREATE|DROP) (TABLE|VIEW)|PRAGMA (user_version|application_id) ?=", re.A)
# Tests name the tables of a record and of a data set only in tests/fixtures/record.hpp and dataset.hpp, so that a change of
# these types changes only the fixtures. This counts members with these names; the remaining ones belong to other types.
table = re.compile(r"^(?!#include)(?:(?!//).)*(?<!\bsink)(?<!\bframe)(?<!\bf)(?<!\bp)(?<!\bconfig)(?<!\bresponse)(?<!\baxes)"
                   r"(?<!\bfound)\.(spd|zone_spd|radar|array|depth|depth_mm)\b(?!\(|\.(known|taps|peak)\b)")
# The limits may be lowered but not raised.
for what, files, pattern, limit in (("write a run", r"[ch]pp|py", by_hand, 20), ("name a table", "[ch]pp", table, 28)):
    found = [place for name in sources if re.fullmatch(rf"tests/(?!fixtures/|lint).*\.({files})", name)
             for place in places(name, pattern.search)]
    if len(found) > limit:
        faults.append(f"{len(found)} lines of tests {what} without tests/fixtures, at most {limit} may: {', '.join(found)}")

# Functions in product code (not in tests) have at most 60 lines.
for name, code in product.items():
    start, lines = 0, code.splitlines()
    for number, line in enumerate(lines):
        if re.match(r"\w", line):
            start = number
        elif line == "}" and number - start >= 60 and not re.match(r"struct|class|enum|namespace", lines[start]):
            faults.append(f"{name}:{start + 1}: a function of {number - start + 1} lines; at most 60")

# Source folders ("rooms") have no circular includes. A folder does not include files from folders that come later in
# `parts`.
# Modules of the Python package have no circular imports, except for imports within functions.
# Subpackages have no circular imports, even within functions.
parts = ("drivers", "acquire", "recon", "sim")
uses = {}
for name, code in product.items():
    room = name.rpartition("/")[0]
    uses.setdefault(room, set()).update(set(re.findall(rf'#include "((?:{"|".join(parts)})/?[^"]*)/[^"/]+"', code)) - {room})
faults += [f"{room} includes {other}, which is above it" for room, others in uses.items() for other in others
           if parts.index(room.split("/")[0]) < parts.index(other.split("/")[0])]
package = root / "recon/python"
modules = {".".join(path.relative_to(package).with_suffix("").parts).removesuffix(".__init__"): path
           for path in (package / "echofuse").rglob("*.py")}
for module, path in modules.items():
    tree = ast.parse(path.read_text(encoding="utf-8"))
    faults += [f"{path.relative_to(root)}:{node.lineno}: a function of {lines} lines; at most 60" for node in ast.walk(tree)
               if isinstance(node, ast.FunctionDef) and (lines := (node.end_lineno or 0) - node.lineno + 1) > 60]
    if tree.body and path.stem != "__main__" and not any(
            isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__" for node in tree.body):
        faults.append(f"{path.relative_to(root)}: has no __all__")
    own = module if path.stem == "__init__" else module.rpartition(".")[0]
    room = ".".join(module.split(".")[:2])
    uses[module] = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        base = ".".join(own.split(".")[:len(own.split(".")) - node.level + 1] + ([node.module] if node.module else []))
        used = {name if (name := f"{base}.{alias.name}") in modules else base for alias in node.names}
        if node in tree.body:
            uses[module] |= used
        uses.setdefault(f"package {room}", set()).update(
            f"package {other}" for name in used if (other := ".".join(name.split(".")[:2])) not in (room, "echofuse"))
for start in uses:
    reached, left = set(), list(uses[start])
    while left:
        if (name := left.pop()) not in reached:
            reached.add(name)
            left += uses.get(name, ())
    if start in reached:
        faults.append(f"{start} is in a circle of includes or imports, among {', '.join(sorted(reached))}")

formatter = shutil.which("clang-format-14")
if formatter:
    run = subprocess.run([formatter, "--dry-run", "-Werror", "--ferror-limit=1", *cpp], cwd=root, capture_output=True,
                         text=True)
    faults += [line for line in run.stderr.splitlines() if "error:" in line]

texts = [root / "README.md", *sorted((root / ".github").glob("*.md"))] + [path for path in tracked if path.suffix == ".md"]
if len((root / "README.md").read_text(encoding="utf-8").splitlines()) > 150:
    faults.append("README.md: over 150 lines")
version = re.search(r"project\(echofuse VERSION ([\d.]+)", (root / "CMakeLists.txt").read_text(encoding="utf-8"))[1]
if f"**Status: version {version}.**" not in (root / "README.md").read_text(encoding="utf-8"):
    faults.append(f"README.md: the status does not state version {version} of CMakeLists.txt")
# Headings are phrases that people search for, so they do not begin with an article, a question word or a preposition.
# Links to files and headings resolve; the name of a heading is computed as GitHub does.
unsearchable = re.compile(r"(A|An|The|What|Which|Who|Why|How|When|Where|Do|Does|Is|Are|Can|With|Without|More|Elsewhere|Rules)\b")
anchors = {}  # maps each manual to the names of its headings
links = []
for path in texts:
    name, text = path.relative_to(root), path.read_text(encoding="utf-8")
    anchors[path] = set()
    for title in re.findall(r"^#+ (.*)$", re.sub(r"^ *```.*?^ *```$", "", text, flags=re.M | re.S), re.M):
        if unsearchable.match(title):
            faults.append(f"{name}: the heading {title!r} begins with {title.split()[0]!r}; expected what one would search for")
        anchor = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        if anchor in anchors[path]:
            faults.append(f"{name}: two headings have the name #{anchor}")
        anchors[path].add(anchor)
    links += [(path, target, anchor) for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([^)\s]*))?\)", text)]
for path, target, anchor in links:
    to = (path.parent / target).resolve() if target else path
    if not to.exists():
        faults.append(f"{path.relative_to(root)}: links to {target}, which does not exist")
    elif anchor and anchor not in anchors.get(to, ()):
        faults.append(f"{path.relative_to(root)}: links to {target}#{anchor}, but no heading has this name")
if len(links) < 100:
    faults.append(f"only {len(links)} links in the manuals; expected at least 100")

# Checks that programs, subcommands and options in manuals (fenced blocks and `code`) exist.
if len(sys.argv) > 1:  # the argument is the folder that contains the built programs
    typed = []  # command lines found in manuals and help texts, each with the name of the manual or program
    options = {}  # maps the words of a command to the options that the command accepts

    def read_help(words, inherited=frozenset()):
        help_text = subprocess.run([pathlib.Path(sys.argv[1]) / words[0], *words[1:], "--help"], capture_output=True,
                                   text=True).stdout
        head, *commands = help_text.split("Subcommands:")
        for option in re.findall(r"^ {2,4}(?:-\w,)?(--[\w-]+)(?:\([^)]*\)|[^a-z\n(])*\n(?! {20})", head, re.M):
            faults.append(f"{' '.join(words)}: {option} has no text")
        for option, said in re.findall(r"^ {2,4}(?:-\w,)?(--[\w-]+)[^\n]*?(?: {2,}|\n {20,})(\S[^\n]*)", head, re.M):
            if re.match(r"(?:of|as|the same)\b|[A-Z][a-z]", said):
                faults.append(f"{' '.join(words)}: help of {option} begins with {said.split()[0]!r}; expected a verb or "
                              "the name of the value, in lower case")
        options[tuple(words)] = inherited | set(re.findall(r"^ {2,4}(?:-\w,)?(--[\w-]+)", head, re.M))
        examples = head.partition("Examples:\n")[2].partition("\n\n")[0].splitlines()
        typed.extend((" ".join(words) + " --help", line.strip()) for line in examples)
        if len(words) > 1 and not commands and not examples:
            faults.append(f"{' '.join(words)} --help: no examples")
        for command in re.findall(r"^  ([a-z]+) ", commands[0], re.M) if commands else ():
            read_help([*words, command], options[tuple(words)])

    for program in ("echofuse-acquire", "echofuse-recon", "echofuse-report", "echofuse-sim", "echofuse-view"):
        read_help([program])
    scripts = {path.name: path.read_text(encoding="utf-8") for path in tracked if root / "scripts" in path.parents}
    package_texts = [path.read_text(encoding="utf-8") for path in modules.values()]
    anywhere = set().union(*options.values(), *(re.findall(r"--[\w-]+", text) for text in [*scripts.values(), *package_texts]))

    def check_command(name, code):
        words = code.split()
        program = words[0].split("/")[-1] if words else ""
        is_script = re.fullmatch(r"(\./)?scripts/[\w/.]*\w", words[0]) if words else None
        named = re.findall(r"(?<![\w-])--[a-z][\w-]*", code)
        if (program,) in options:
            chain = (program,)
            for word in words[1:]:
                if (*chain, word) not in options:
                    if re.fullmatch("[a-z]+", word) and any(len(o) > len(chain) and o[:len(chain)] == chain for o in options):
                        faults.append(f"{name}: `{' '.join(chain)}` has no command {word}")
                    break
                chain = (*chain, word)
            known = options[chain]
        elif is_script and program in scripts:
            known = re.findall(r"--[\w-]+", scripts[program])
        elif is_script:
            return faults.append(f"{name}: no such script: {program}")
        elif not code.startswith("--") and not any(program == key[-1] for key in options):
            return  # the command belongs to another project
        else:
            known = anywhere
        faults.extend(f"{name}: {o} of `{code}` does not exist" for o in named if o not in known)

    for name, line in typed:
        check_command(name, line.partition(" -- ")[0])
    for path in texts:
        name, text = path.relative_to(root), path.read_text(encoding="utf-8")
        fenced = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.M | re.S)
        for language, block in fenced:
            lines = block.splitlines()
            if language != "sh" and any(re.match(r"(\S*/)?(echofuse-\w+|scripts/\S+)( |$)", line) for line in lines):
                faults.append(f"{name}: a block of commands that is not `sh`, so that no test runs it")
        shell = [line for language, block in fenced if language == "sh" for line in block.splitlines()]
        spans = re.findall(r"`([^`]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S))
        for code in [*shell, *(" ".join(span.split()) for span in spans)]:
            for part in re.split(r" -- | && | \| ", code):
                check_command(name, part)

# udev ignores invalid rules and reports them only in the system journal.
udev_keys = {"ACTION": "==", "SUBSYSTEM": "==", "ATTR": "==", "ATTRS": "==", "ENV": "== =", "GROUP": "=", "MODE": "=",
             "TAG": "+=", "GOTO": "=", "LABEL": "="}
rules = (root / "config/70-echofuse.rules").read_text(encoding="utf-8")
for number, line in enumerate(rules.splitlines(), 1):
    for item in [] if line.startswith("#") or not line else line.split(", "):
        token = re.fullmatch(r'([A-Z]+)(\{[\w/]+\})?(==|=|\+=)"([^"]+)"', item)
        if not token or token[3] not in udev_keys.get(token[1], "").split() + ["="] * (token[2] == "{power/control}"):
            faults.append(f"config/70-echofuse.rules:{number}: not a udev rule: {item}")
    if re.match('SUBSYSTEM=="(tty|video4linux)"', line) and ("GROUP=" in line or 'TAG+="uaccess"' not in line):
        faults.append(f"config/70-echofuse.rules:{number}: its group is the system's; expected uaccess alone")
if set(re.findall(r'GOTO="(\w+)"', rules)) != set(re.findall(r'LABEL="(\w+)"', rules)):
    faults.append("config/70-echofuse.rules: GOTO and LABEL differ")

print("\n".join(faults) or f"{len(cpp)} sources keep the house rules")
sys.exit(bool(faults))
