#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/audit_run.py RUN.sqlite LOG [--json]: compares a run, record by record, with the log of the simulated
laboratory (echofuse-sim lab --log LOG), and accounts for every tag and frame. Exits with 1 if a difference cannot be
explained."""
import argparse
import bisect
import collections
import itertools
import json
import sqlite3
import sys

# Candidates for the longest transport delay. The audit reports the shortest candidate that explains the run.
LATENCIES_NS = [20_000_000 * 2**i for i in range(8)]
LATENCY_NS = 250_000_000
GRACE_NS = 500_000_000  # time after the end of a slot during which frames of the slot are still accepted
SETTLING_NS = 5_000_000_000  # time that the clock fit needs to become valid again after a clock jump
OVERRUN_DELAY_NS = 5_000_000_000
CLOCK_ERROR_NS = 100_000_000  # smaller backward steps of a device clock are not detected
SETTLED = 200  # number of samples that a clock fit needs to become valid
NUMBER_FIELD = range(20, 24)  # byte range of the frame number in a radar frame
MAX_PLAUSIBLE_GAP = 100  # larger gaps in radar frame numbers count as losses only after the next frame confirms them
FULLY_RECEIVED = {"sent", "garbage"}


class Run:
    def __init__(self, path):
        db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        db.row_factory = sqlite3.Row
        self.records = [dict(r) for r in db.execute(
            "SELECT r.idx, slot_start_ns start, slot_end_ns end, tags, spd_lost, radar_lost, depth_lost, radar_frames,"
            " radar_last, depth_frames, depth_last, ifnull(l.spd, 0) spd_late, ifnull(l.radar, 0) radar_late,"
            " ifnull(l.depth, 0) depth_late, ifnull(radar_clock_samples, 0) radar_samples,"
            " ifnull(depth_clock_samples, 0) depth_samples FROM record r LEFT JOIN late l ON r.idx = l.idx"
            " ORDER BY r.idx")]
        self.rows = db.execute("SELECT count(*) FROM record").fetchone()[0]
        self.counters = collections.Counter()
        for source, name, value in db.execute("SELECT source, name, value FROM counter"):
            self.counters[source, name] += value


def read_log(path):
    devices = collections.defaultdict(list)
    with open(path) as log:
        for line in log:
            entry = json.loads(line)
            devices[entry["device"]].append(entry)
    return devices


class Account:
    def __init__(self, name):
        self.name, self.rows, self.unexplained = name, [], []

    def put(self, what, number):
        self.rows.append((what, number))

    def fault(self, text):
        self.unexplained.append(text)


def bounded(account, what, run, column, items, late, tolerance=0):
    """Checks the running sums of a record column against the log, and returns the sum over all records. items: tuples
    (earliest time, latest time by which a record must contain the items or None, amount). An unknown amount may have
    arrived before the run. Each running sum plus the unknown amount must lie between two amounts from the log: the
    amount that must have arrived by the end of the record, and the amount that may have arrived by then.
    tolerance: error of the amounts, relative to the running sum."""
    may_t, may = accumulate(sorted((first, amount) for first, _, amount in items))
    must_t, must = accumulate(sorted((by, amount) for _, by, amount in items if by is not None))
    low, high, total = 0, float("inf"), 0
    for record in run.records:
        total += record[column]
        low = max(low, must[bisect.bisect_left(must_t, record["end"])] - late - total)
        high = min(high, may[bisect.bisect_left(may_t, record["end"])] - total)
        if low - high > tolerance * total:
            account.fault(f"record {record['idx']}: {what}: {low - high} {'missing' if total + high < low else 'unexplained'}")
            low, high = 0, float("inf")
            low = max(0, must[bisect.bisect_left(must_t, record["end"])] - late - total)
    return total


def accumulate(pairs):
    return [t for t, _ in pairs], [0, *itertools.accumulate(amount for _, amount in pairs)]


def connections(entries):
    """Returns one list of bridge blocks for each connection."""
    all_of_them = []
    for entry in entries:
        if entry["what"] == "connected":
            all_of_them.append([])
        elif "seq" in entry or entry["what"] == "overrun":
            if all_of_them:
                all_of_them[-1].append(entry)
    return all_of_them


class Tags:
    """Simulates how the daemon's bridge client counts the blocks sent by a bridge."""

    def __init__(self, entries, latency_ns):
        connection_list = connections(entries)
        self.latency_ns = latency_ns
        self.jumps = clock_jumps(entries)  # tags sent during these times may be assigned to earlier slots
        self.clock_faults = min((e["t"] for e in entries if e["what"].startswith("begin clock_")), default=float("inf"))
        self.sums = collections.Counter()  # number of tags, by the fate of their block
        self.delivered, self.losses = [], []  # lists of (earliest time, latest time, amount)
        self.lost_blocks = self.received = self.full = 0  # received: number of tags; full: of blocks with tags
        self.pending = 0  # tags lost since the last delivered block, including those of earlier connections
        for number, connection in enumerate(connection_list):
            self.take(connection, number > 0)

    def earliest(self, block):
        """Returns the earliest possible time stamp of the first tag in a block."""
        if any(begin < block["t"] < end for begin, end in self.jumps):
            return block["first"] - GRACE_NS
        return block["first"] - (CLOCK_ERROR_NS if block["t"] > self.clock_faults else 0)

    def take(self, connection, rejoined):
        expected, greeted, broken = 0, False, False
        for block in sorted(connection, key=lambda b: (b.get("seq", -1), b["t"])):
            if block["what"] == "overrun":
                self.sums["overrun"] += block["tags"]
                continue
            what = "behind damage" if broken and block["what"] == "sent" else block["what"]
            self.sums[what] += block["tags"]
            broken = broken or what in ("corrupt", "garbage")  # a damaged block ends the connection
            if what != "sent":
                continue
            self.pending += block["seq"] - expected
            expected = block["seq"] + 1
            if not greeted and block["kind"] != 0:
                self.pending += 1
                self.sums["before a hello"] += block["tags"]
                self.sums["sent"] -= block["tags"]
                continue
            self.pending += rejoined and not greeted
            greeted = True
            if block["kind"] != 1:
                continue
            by = block["t"] + self.latency_ns
            first = self.earliest(block)
            self.delivered.append((first, by, block["tags"], block["t"]))
            self.received += block["tags"]
            self.full += block["tags"] > 0
            if self.pending:  # the daemon estimates the tags of a lost block from the mean size of a block
                self.losses.append((first, by, round(self.pending * max(1, self.received / max(1, self.full)))))
                self.lost_blocks += self.pending
            self.pending = 0


def audit_tags(run, entries):
    for latency_ns in LATENCIES_NS:
        account = audit_tags_within(run, entries, latency_ns)
        if not account.unexplained:
            break
    account.put("longest transport delay, ms", latency_ns // 1_000_000)
    return account


def audit_tags_within(run, entries, latency_ns):
    account = Account("tdc")
    tags = Tags(entries, latency_ns)
    overruns = [(e["t"] - OVERRUN_DELAY_NS, None, e["tags"]) for e in entries if e["what"] == "overrun"]
    late, outside = run.counters["spd", "late"], run.counters["spd", "outside"]
    items = [(first, by, n) for first, by, n, _ in tags.delivered]
    in_records = bounded(account, "tags", run, "tags", items, late)
    lost = bounded(account, "lost tags", run, "spd_lost", tags.losses + overruns, sum(n for *_, n in tags.losses) * (late > 0), 0.02)
    received = run.counters["spd", "tags"]
    sums = [0, *itertools.accumulate(n for *_, n, _ in tags.delivered)]
    if received not in set(sums):
        near = sums[bisect.bisect_left(sums, received) - 1]
        account.fault(f"the driver received {received} tags, but these do not end with a complete block; "
                      f"the last complete block ends at tag {near}")
    before = received - in_records - late - outside
    if before != run.counters["spd", "early"]:
        account.fault(f"{before} received tags are neither in a record nor counted as late or outside; "
                      f"{run.counters['spd', 'early']} are counted as early")
    start = run.records[0]["start"]
    may_before = sum(n for first, _, n, _ in tags.delivered if first < start)
    if not 0 <= before <= may_before:
        account.fault(f"{before} received tags are neither in a record nor counted as late or outside; at most "
                      f"{may_before} arrived before the run")
    after = sum(tags.sums.values()) - received - sum(v for k, v in tags.sums.items() if k != "sent")
    account.put("made", sum(tags.sums.values()))
    for what in ("dropped", "corrupt", "garbage", "behind damage", "cut", "unsent", "overrun", "before a hello"):
        account.put(f"not delivered: {what}", tags.sums[what])
    account.put("in records", in_records)
    account.put("late", late)
    account.put("outside the run's slots", outside)
    account.put("received before the run", before)
    account.put("after the daemon ended", after)
    account.put("blocks lost according to the log", tags.lost_blocks)
    account.put("tags lost according to the records", lost)
    return account


class Frames:
    def __init__(self, sensor, entries):
        self.sensor = sensor
        self.by_number = {}
        for entry in entries:
            if "frame" not in entry:
                continue
            known = self.by_number.get(entry["frame"])
            # keeps the log entry of the client that received the frame
            if not known or entry["what"] in FULLY_RECEIVED:
                self.by_number[entry["frame"]] = entry

    def certain(self, number):
        return number in self.by_number and self.by_number[number]["what"] in FULLY_RECEIVED

    # frames have no checksum, so the daemon may accept a damaged frame with a wrong number
    def doubtful(self, number):
        entry = self.by_number.get(number)
        return self.sensor == "radar" and entry is not None and entry["what"] == "corrupt"

    def renumbered(self, first, last):
        return sum(1 for n in range(first, last + 1)
                   if self.doubtful(n) and self.by_number[n]["damage"] in NUMBER_FIELD)

    def plausible(self, number, previous, record):
        return ((self.certain(number) or self.doubtful(number)) and (previous is None or number > previous) and
                self.by_number[number]["t"] < record["end"] + GRACE_NS)


def clock_jumps(entries):
    """Returns the intervals (from, to) of host time during which the device clock was wrong, so
    that data are assigned to wrong slots."""
    jumps, begun, lasting = [], None, 0  # several clock faults may overlap
    for entry in entries:
        if entry["what"] == "begin clock_offset":
            begun = entry["t"] if lasting == 0 else begun
            lasting += 1
        elif entry["what"] == "end clock_offset" and lasting > 0:
            lasting -= 1
            if lasting == 0:
                jumps.append((begun - GRACE_NS, entry["t"] + SETTLING_NS))
    return jumps + ([(begun - GRACE_NS, float("inf"))] if lasting > 0 else [])


class Range:
    """A range of consecutive records; the number of the last frame in the last record is known. The
    range contains the frame numbers from previous + 1 to last."""

    def __init__(self, sensor, records, previous, last):
        self.records, self.previous, self.last = records, previous, last
        self.got, self.lost, self.late = (sum(r[f"{sensor}_{what}"] for r in records) for what in ("frames", "lost", "late"))
        self.numbers = range(previous + 1, last + 1)
        self.settling = any(r[f"{sensor}_samples"] < SETTLED for r in records)

    def movable(self, frames):
        """Returns the number of frames from this range of records that may be stored in a
        neighbouring range: late frames, damaged frames, and all frames while the clock fit is not
        valid. A late frame may have a higher number than the last frame of its record. The daemon
        assigns damaged frames, and frames received without a valid fit, to slots by their arrival
        time."""
        return self.late + (self.got if self.settling else sum(map(frames.doubtful, self.numbers)))


def ranges_of(account, run, frames, jumps):
    """Divides the records into ranges; returns the ranges, and the records that follow the last
    range."""
    sensor, found, records, previous = frames.sensor, [], [], None
    for record in run.records:
        records.append(record)
        last = record[f"{sensor}_last"]
        if any(begin < record["end"] and record["start"] < end for begin, end in jumps):
            continue  # a slot without a known frame number belongs to the same range as the next slot
        if last is None or not frames.plausible(last, previous, record):
            got = sum(r[f"{sensor}_frames"] for r in records)
            if last is not None and not frames.certain(last) and frames.renumbered(previous or 0, (previous or 0) + got + 20) == 0:
                account.fault(f"record {record['idx']}: its last frame {last} was not sent")
            # the frame number is damaged or the frame is in a later slot, so the range also includes the next record
            continue
        if previous is None:
            previous = last - sum(r[f"{sensor}_frames"] + r[f"{sensor}_lost"] + r[f"{sensor}_late"] for r in records)
        found.append(Range(sensor, records, previous, last))
        previous, records = last, []
    return found, records


def audit_frames(run, sensor, entries):
    account = Account(sensor)
    frames = Frames(sensor, entries)
    counts = collections.Counter()
    ranges, rest = ranges_of(account, run, frames, clock_jumps(entries))
    left = 0
    if sensor == "radar":
        for before, after in zip(ranges, ranges[1:]):
            move_jump(before, after)
    for i, each in enumerate(ranges):
        near = sum(r.movable(frames) for r in ranges[max(0, i - 1):i + 2])
        left += audit_range(account, frames, each, near, left, counts)
    # Frames missing in the last range may be in the records after it.
    if abs(left) > (ranges[-1].movable(frames) if rest else 0):
        account.fault(f"the total of frames in records, late frames and lost frames differs by {abs(left)} from the number of sent frames")
    got = sum(r[f"{sensor}_frames"] for r in rest)
    previous = ranges[-1].last if ranges else None
    may = sum(1 for n in frames.by_number if frames.plausible(n, previous, run.records[-1]))
    if got > may:  # checks the records after the last range
        account.fault(f"the last records have {got} {sensor} frames; at most {may} were sent")
    counts["in records"] += got
    late, outside, early = (run.counters[sensor, what] for what in ("late", "outside", "early"))
    if (of_records := sum(r[f"{sensor}_late"] for r in run.records)) != late:
        account.fault(f"the run counts {late} late frames, but its records count {of_records}")
    nowhere = (run.counters[sensor, "frames"] - run.counters[sensor, "early_frames"] - late - outside - early -
               run.counters[sensor, "duplicate"] - sum(r[f"{sensor}_frames"] for r in run.records))
    if nowhere:
        account.fault(f"{nowhere} received frames are not accounted for")
    # If the device clock is slow, a frame may be assigned to an earlier slot.
    may = sum(1 for e in frames.by_number.values() if e["t"] < run.records[0]["start"] + GRACE_NS)
    if early > may:
        account.fault(f"{early} frames are counted as early; at most {may} arrived before the run")
    for what, number in counts.items():
        account.put(what, number)
    account.put("late", late)
    account.put("outside the run's slots", outside)
    account.put("received before the run", early)
    return account


def move_jump(before, after):
    """Moves a loss to the previous range, because the daemon counts a large jump in the frame
    number only after the next frame confirms it."""
    missing = len(before.numbers) - before.got - before.late - before.lost
    if missing > MAX_PLAUSIBLE_GAP:
        move = min(missing, after.lost)
        before.lost += move
        after.lost -= move


def audit_range(account, frames, part, near, before, counts):
    """Returns the number of missing frames, which is negative if the range contains excess frames.
    Up to `near` frames may be stored in a neighbouring range, but the sum over all ranges must be
    0. `before` is the sum over the previous ranges."""
    numbers, arrived = part.numbers, part.got + part.late
    certain = sum(map(frames.certain, numbers))
    doubtful = sum(map(frames.doubtful, numbers))
    for n in numbers:
        counts["sent: " + (frames.by_number[n]["what"] if n in frames.by_number else "never")] += 1
    counts["in records"] += part.got
    counts["counted as lost"] += part.lost
    counts["sent, lost in transport"] += max(0, certain - arrived)
    where = f"record {part.records[-1]['idx']}: {frames.sensor} frames {part.previous + 1} to {part.last}: "
    if arrived > certain + doubtful + near:
        account.fault(where + f"{arrived} arrived, but only {certain + doubtful} were sent")
    left = len(numbers) - arrived - part.lost
    if left == 0:
        return 0
    # If the number of the last frame is corrupted, it may equal the number of an earlier frame.
    if frames.renumbered(part.previous - 2, max(part.last, part.previous + arrived)):
        settled = -before if left * before < 0 and abs(before) <= abs(left) else 0
        counts["miscounted because of damaged numbers"] += left - settled
        return settled
    if abs(left) > near:
        account.fault(where + f"{len(numbers) - arrived} did not arrive, but {part.lost} are counted as lost")
        return 0
    return left


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", help="run file")
    parser.add_argument("log", help="log file written by `echofuse-sim lab --log`")
    parser.add_argument("--json", action="store_true", help="print the result of the audit as one JSON object")
    args = parser.parse_args()
    run, log = Run(args.run), read_log(args.log)
    general = Account("run")
    general.put("records", run.rows)
    if [r["idx"] for r in run.records] != list(range(run.rows)):
        general.fault("the record indices have gaps")
    faults = collections.Counter(f"{device}: {e['what'][6:]}" for device, entries in log.items() for e in entries
                                 if e["what"].startswith("begin ") and e["t"] < run.records[-1]["end"])
    for fault, number in sorted(faults.items()):
        general.put("fault " + fault, number)
    accounts = [general, audit_tags(run, log["tdc"]), audit_frames(run, "radar", log["radar"]),
                audit_frames(run, "depth", log["depth"])]
    unexplained = [f"{a.name}: {text}" for a in accounts for text in a.unexplained]
    if args.json:
        print(json.dumps({"schema": 1} | {a.name: dict(a.rows) for a in accounts} | {"unexplained": unexplained}))
    else:
        for account in accounts:
            for what, number in account.rows:
                print(f"{account.name:6} {what:45} {number:12}")
        print("\n".join(["UNEXPLAINED: " + text for text in unexplained] or ["every difference is explained"]))
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
