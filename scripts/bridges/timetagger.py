#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the tags of a Swabian Instruments Time Tagger over the echofuse bridge protocol, through the
vendor's own Python library. echofuse connects with tdc.address = "bridge:tcp://HOST:PORT"."""
import argparse
import pathlib
import statistics
import sys
import time

import bridge
import pack
import vendor
from pack import np

MAX_EVENTS = (1 << 28) - 1  # largest buffer that the library accepts
NO_DATA_S = 3.0              # test the device after this time without tags
ANSWER_MS = 1000             # time limit for the answer to the test
RATE_S = 1.0                 # time over which the tag rate is averaged
WARNING_S = 60.0                # minimum time between two identical warnings

FILTER_HELP = """\
The conditional filter passes only the first laser pulse after each photon, so that the USB load
depends on the photon rate and not on the laser rate. But the histogram needs the last laser pulse
before the photon. Therefore, with
  --conditional-filter PS
the device delays the sync by PS picoseconds before the filter, and the bridge subtracts PS after the
filter. The pulse that caused the photon then passes the filter, and the tags keep their true times.
PS must be longer than the longest time of flight of interest and shorter than the laser period, e.g.
48000 for 7 m and 20 MHz. A device without hardware delays (Time Tagger 20) needs a cable with this
delay in the sync line instead; use --conditional-filter 0 --input-delay START=-PS. With the filter,
the bridge applies each --input-delay in software, after the filter. The filter cannot be combined
with --event-divider on the sync channel.

If another program shares the Time Tagger (startServer in Python, or Time Tagger Lab), --network HOST
receives the tags from that program. Settings without an option keep their values on the server. The
bridge applies --input-delay itself. All other settings require a server with AccessMode.Control.

--scan CH prints the pulse rate at each trigger level, and the plateau of the rate. The middle of the
plateau is a good trigger level."""
RESOLUTIONS = ("Standard", "HighResA", "HighResB", "HighResC")
# Options that change hardware settings.
HARDWARE = ("trigger_level", "dead_time", "event_divider", "conditional_filter", "test_signal")


def setting(kind, low, high):
    """Returns an argparse type that parses CH=VALUE."""
    parse_value = bridge.number(kind, low, high)

    def parse(text):
        channel, equals, value = text.partition("=")
        try:
            return int(channel), parse_value(value)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r}: expected CH=VALUE") from None
    return parse


def parse_arguments(arguments):
    parser = bridge.parser(__doc__, FILTER_HELP)
    number = bridge.number
    add = parser.add_argument
    add("--listen", metavar="HOST:PORT", type=bridge.listen_address, default=("127.0.0.1", 41110),
        help="address to which echofuse connects (default: 127.0.0.1:41110); use only trusted networks, because a "
             "client needs no password")
    add("--serial", default="", help="serial number of the device, if several are attached")
    add("--network", metavar="HOST[:PORT]", help="use a Time Tagger server instead of a local device (default port: 41101)")
    add("--file", metavar="X.ttbin", type=pathlib.Path, help="replay this recording in real time, starting when the first client connects")
    add("--resolution", choices=RESOLUTIONS, help="resolution mode of the device; finer modes have fewer channels")
    add("--scan", metavar="CH", type=number(int, -99, 99),
        help="measure the pulse rate of this channel at each trigger level, print the rates, and exit")
    add("--start-channel", metavar="CH", type=number(int, -99, 99), default=1,
        help="channel of the laser sync (default: 1); for the falling edge, use the negative channel number, or add 8 "
             "on old devices with inputs 0 to 7")
    add("--click-channel", metavar="CH", type=number(int, -99, 99), default=2, help="channel of the detector (default: 2)")
    per_channel = dict(action="append", default=[])
    add("--trigger-level", metavar="CH=V", type=setting(float, -5, 5), **per_channel,
        help="trigger level of a channel, V; may be repeated; for a negative channel, write e.g. --trigger-level=-2=0.5")
    add("--input-delay", metavar="CH=PS", type=setting(int, -10**12, 10**12), **per_channel,
        help="delay of a channel, ps; may be repeated")
    add("--dead-time", metavar="CH=PS", type=setting(int, 0, 10**12), **per_channel,
        help="dead time of a channel, ps; the device rounds this value, and the bridge prints the rounded value; may be repeated")
    add("--event-divider", metavar="CH=N", type=setting(int, 1, 65535), **per_channel,
        help="keep only every N-th event of a channel; may be repeated")
    add("--conditional-filter", metavar="PS", type=number(int, 0, 2_000_000),
        help="send only the laser pulses that follow a photon, and delay the sync by PS picoseconds (explained below)")
    add("--test-signal", action="store_true", help="switch on the built-in test signal on the start channel and the click channel")
    add("--max-events", metavar="N", type=number(int, 1000, MAX_EVENTS), default=1 << 24,
        help="number of tags that fit in the buffer of the library (default: 16777216); if the buffer overflows, tags "
             "are lost, and one lost tag is counted for each block")
    add("--block-ms", metavar="MS", type=number(float, 1, 500), default=20.0, help="time between blocks of tags, ms (default: 20)")
    options = parser.parse_args(arguments)
    given = ["--" + name.replace("_", "-") for name in ("serial", "network", "file", "resolution", "scan", *HARDWARE)
             if getattr(options, name) not in (None, "", [], False)]
    for place, others in (("--file", given), ("--network", [name for name in given if name in ("--serial", "--resolution")])):
        if place in given and set(others) - {place}:
            parser.error(f"{place} cannot be combined with {', '.join(sorted(set(others) - {place}))}")
    if options.network and ":" not in options.network:
        options.network += ":41101"
    used = {abs(options.start_channel), abs(options.click_channel)}
    if options.start_channel == options.click_channel:
        parser.error("--start-channel and --click-channel must differ")
    for name in ("trigger_level", "input_delay", "dead_time", "event_divider"):
        for channel, _ in getattr(options, name):
            if abs(channel) not in used:
                parser.error(f"--{name.replace('_', '-')}: channel {channel} is neither the start channel nor the click channel")
    if options.conditional_filter is not None and any(abs(c) == abs(options.start_channel)
                                                      for c, _ in options.event_divider):
        parser.error("--event-divider on the start channel cannot be combined with --conditional-filter, because the "
                     "divider would drop pulses that the filter lets through")
    return options


class Tagger:
    """An open time tagger and its tag stream."""

    def __init__(self, library, options):
        self._library, self._options = library, options
        self._channels = [options.start_channel, options.click_channel]
        self._losses = Losses(options)
        self._stream = None
        self._dark_reported = False
        self._tagger = open_tagger(library, options)
        self._replay = Replay(library, self._tagger, options.file) if options.file else None
        try:
            self._configure()
            open_stream = custom_stream if hasattr(library, "CustomMeasurement") else BufferStream
            self._stream = open_stream(library, self._tagger, self._channels, options.max_events)
            self._last_tags_s = time.monotonic()
        except Exception:
            self.close()
            raise

    def _configure(self):
        tagger, options = self._tagger, self._options
        # change only the settings given as options, because other clients share the device
        shared = options.network or options.file
        try:
            for channel in () if shared and not options.test_signal else self._channels:
                tagger.setTestSignal(channel, options.test_signal)
            for channel, volts in options.trigger_level:
                tagger.setTriggerLevel(channel, volts)
            self._set_delays()
            for channel, requested_ps in options.dead_time:
                bridge.say(f"dead time of channel {channel}: {tagger.setDeadtime(channel, requested_ps)} ps (requested: {requested_ps} ps)")
            filtered = options.conditional_filter is not None
            if filtered or not shared:
                tagger.setConditionalFilter([options.click_channel] if filtered else [],
                                            [options.start_channel] if filtered else [])
            for channel, divider in options.event_divider:
                tagger.setEventDivider(channel, divider)
        except Exception as error:
            if not options.network:
                raise
            raise RuntimeError(f"{bridge.text_of(error)}; a server with AccessMode.Listen refuses settings; start the "
                               "server with AccessMode.Control, or omit the options") from None
        if not options.file:
            tagger.sync()  # after sync(), all tags are measured with the new settings

    def _set_delays(self):
        tagger, start = self._tagger, self._options.start_channel
        delays = dict(self._options.input_delay)
        ahead_ps = self._options.conditional_filter
        if ahead_ps is None:
            for channel, delay_ps in delays.items():
                (tagger.setDelayClient if self._options.network else tagger.setInputDelay)(channel, delay_ps)
            return
        if ahead_ps > 0:
            tagger.setDelayHardware(start, ahead_ps)
        delays[start] = delays.get(start, 0) - ahead_ps
        for channel, delay_ps in delays.items():
            tagger.setDelaySoftware(channel, delay_ps)

    def hello(self):
        tagger = self._tagger
        if self._replay:
            return {"model": "Time Tagger recording", "serial": self._options.file.name, "firmware": ""}
        firmware = tagger.getFirmwareVersion() if hasattr(tagger, "getFirmwareVersion") else ""
        levels = ", ".join(f"{channel}: {tagger.getTriggerLevel(channel):.3g} V" for channel in self._channels)
        return {"model": tagger.getModel(), "serial": tagger.getSerial(),
                "firmware": f"{' '.join(firmware.split())}; trigger levels {levels}"}  # shown on the live page

    def poll(self, server):
        ended = self._replay and self._replay.step(server.clients > 0)
        if not self._stream.isRunning():
            raise RuntimeError("the tag stream has stopped")
        blocks, lost = self._stream.take()
        for packed in blocks:
            server.send(bridge.TAGS, packed.payload, packed.items)
        if lost:
            server.lose(lost)
        self._losses.look(blocks, lost, server.dropped)
        if ended and not blocks:
            raise bridge.Finished(f"the recording {self._options.file} has ended")
        if not self._replay:
            self._watch(bool(blocks))
        return 0 if lost else self._options.block_ms * 1e-3

    def _watch(self, has_tags):
        """Raises an error if the device is gone. isRunning() may still return true after the device
        has been unplugged. sync() succeeds only if the device responds, and does not need any
        tags."""
        now = time.monotonic()
        if has_tags:
            self._last_tags_s, self._dark_reported = now, False
        if self._options.network and not self._tagger.isConnected():
            raise RuntimeError(f"the connection to the server {self._options.network} was lost")
        if now - self._last_tags_s < NO_DATA_S:
            return
        if not self._tagger.sync(ANSWER_MS):
            raise RuntimeError(f"no tags have arrived for {NO_DATA_S:g} s, and the device does not answer; it is disconnected")
        if not self._dark_reported:
            bridge.say(f"no tags have arrived for {NO_DATA_S:g} s, but the device answers; check that the laser is on "
                       "and that the trigger levels are correct")
        self._dark_reported = True
        self._last_tags_s = time.monotonic()

    def close(self):
        if self._stream is not None:
            self._stream.stop()
        self._stream = None
        self._library.freeTimeTagger(self._tagger)


def open_tagger(library, options):
    if options.network:
        return library.createTimeTaggerNetwork(options.network)
    if options.file:
        if not options.file.is_file():
            raise RuntimeError(f"{options.file}: no such file")
        new = hasattr(library.TimeTaggerVirtual, "run")
        return library.createTimeTaggerVirtual(*[str(options.file)] * new)
    serial = bridge.choose(list(library.scanTimeTagger()), options.serial, "Time Tagger")
    if options.resolution:
        return library.createTimeTagger(serial, getattr(library.Resolution, options.resolution))
    return library.createTimeTagger(serial)


class Replay:
    """Replays a recording with a virtual tagger. Newer libraries provide run(), older ones setReplaySpeed() and
    replay()."""

    def __init__(self, library, tagger, path):
        self._tagger, self._path, self._began = tagger, path, False

    def step(self, running):
        """Starts the replay when `running` becomes true; returns True when it has ended."""
        tagger = self._tagger
        if self._began:
            return tagger.waitForCompletion(timeout=0)
        if running:
            self._began = True
            if hasattr(tagger, "run"):
                tagger.run(speed=1.0)
            else:
                tagger.setReplaySpeed(1.0)
                tagger.replay(str(self._path))
        return False


class BufferStream:
    """Tag stream for libraries without CustomMeasurement: wraps TimeTagStream, which returns the tags as four
    columns."""

    def __init__(self, library, tagger, channels, max_events):
        self._stream, self._max_events = library.TimeTagStream(tagger, max_events, channels), max_events
        self._channels = channels
        self.isRunning, self.stop = self._stream.isRunning, self._stream.stop

    def take(self):
        """Returns the new tags as blocks, and a lower bound for the number of lost tags."""
        data = self._stream.getData()
        tags = np.zeros(data.size, pack.RECORD)
        for name, column in (("type", data.getEventTypes()), ("missed_events", data.getMissedEvents()),
                             ("channel", data.getChannels()), ("time", data.getTimestamps())):
            tags[name] = column
        # if the buffer is full, at least one tag was lost; the library does not count lost tags
        return pack.pack(tags, self._channels), int(data.size >= self._max_events)


def custom_stream(library, tagger, channels, max_events):
    """Tag stream as a custom measurement: the library calls process() with 16-byte tags. Has the same interface as
    BufferStream."""
    class Stream(library.CustomMeasurement):
        def __init__(self):
            super().__init__(tagger)
            self._blocks, self._held, self._lost = [], 0, 0
            for channel in channels:
                self.register_channel(channel)
            self.finalize_init()

        def process(self, incoming_tags, begin_time, end_time):
            # The library calls process() on the library's thread and holds self.mutex; the array is valid only during
            # the call.
            if len(incoming_tags) == 0:
                return
            if self._held + len(incoming_tags) > max_events:
                self._lost += len(incoming_tags)
                return
            blocks = pack.pack(incoming_tags, channels)
            self._blocks += blocks
            self._held += sum(packed.items for packed in blocks)

        def take(self):
            with self.mutex:
                blocks, lost = self._blocks, self._lost
                self._blocks, self._held, self._lost = [], 0, 0
            return blocks, lost
    return Stream()


class Losses:
    """Prints a warning with advice when tags are lost, at most once a minute."""

    def __init__(self, options):
        self._options = options
        self._begin_s, self._next_warning_s = time.monotonic(), 0.0
        self._tags = self._starts = self._dropped = 0
        self._places = {}  # where tags were lost, in order of occurrence (a dict used as an ordered set)

    def look(self, blocks, lost, dropped):
        """Updates the statistics with new blocks, tags lost in the stream, and the server's total of dropped tags."""
        for packed in blocks:
            self._tags += packed.items
            self._starts += packed.starts
            if packed.overflows:
                self._places["the device's buffer overflows"] = True
        if lost:
            self._places["the buffer is full (raise --max-events or lower --block-ms)"] = True
        if dropped != self._dropped:
            self._places["echofuse reads too slowly"] = True
        self._dropped = dropped
        now = time.monotonic()
        if now - self._begin_s >= RATE_S:
            if self._places and now >= self._next_warning_s:
                self._report(now - self._begin_s)
                self._next_warning_s = now + WARNING_S
            self._begin_s, self._tags, self._starts, self._places = now, 0, 0, {}

    def _report(self, seconds):
        rate = self._tags / max(seconds, 1e-9)
        text = f"tags are lost at a tag rate of {rate * 1e-6:.2f} million/s ({16e-6 * rate:.0f} MB/s): " \
            f"{' and '.join(self._places)}"
        if self._options.conditional_filter is None and 2 * self._starts > self._tags:
            text += f"; {100 * self._starts / self._tags:.0f} % of the tags are laser pulses; --conditional-filter sends " \
                "only the laser pulses that follow a photon"
        bridge.say(text)


def scan(library, options):
    """Measures and prints a channel's rate at each trigger level, and prints the plateau; then
    restores the original level."""
    tagger, channel, steps, step_ps = open_tagger(library, options), options.scan, 51, 10**11
    before = tagger.getTriggerLevel(channel)
    try:
        low, high = tagger.getDACRange()
        counter, found = library.Countrate(tagger, [channel]), []
        for step in range(steps):
            volts = round(low + (high - low) * step / (steps - 1), 3)
            tagger.setTriggerLevel(channel, volts)
            tagger.sync()
            counter.startFor(step_ps)
            counter.waitUntilFinished()
            found.append((volts, float(counter.getData()[0])))
    finally:
        tagger.setTriggerLevel(channel, before)
        library.freeTimeTagger(tagger)
    highest = max(rate for _, rate in found) or 1
    for volts, rate in found:
        print(f"{volts:7.3f} V {rate:12.0f} /s  {'#' * round(40 * rate / highest)}")
    best = plateau(found)
    if len(best) < 3:
        bridge.say(f"channel {channel} has no plateau; check the pulses and the edge (the sign of the channel number)")
        return 5
    middle = round((best[0][0] + best[-1][0]) / 2, 3)
    print(f"plateau from {best[0][0]} to {best[-1][0]} V, {statistics.median(rate for _, rate in best):.0f} /s: "
          f"--trigger-level={channel}={middle}")
    return 0


def plateau(found):
    """Returns the longest run of consecutive levels with rates above 0 and within 10 % of the run's first rate."""
    best = row = []
    for each in found:
        same = row and abs(each[1] - row[0][1]) <= 0.1 * row[0][1]
        row = [*row, each] if same else [each] * (each[1] > 0)
        best = max(best, row, key=len)
    return best


def main():
    vendor.use_python()
    options = parse_arguments(sys.argv[1:])
    bridge.require_packages()
    if pack.failure:
        bridge.fail(f"{pack.failure}; the library is part of the build: copy it into the folder of the bridge, or set "
                    "ECHOFUSE_BRIDGE_LIBRARY to its path; it requires Debian's libisal2")
    pack.keep_freed_memory()
    # module names of newer and older libraries
    library = vendor.library(["Swabian.TimeTagger", "TimeTagger"], "Swabian-TimeTagger")
    vendor.check_version("Swabian-TimeTagger", library.getVersion(), "2.17.4")
    if options.scan is not None:
        try:
            return scan(library, options)
        except Exception as error:
            bridge.fail(bridge.text_of(error))
    return bridge.run(options.listen, lambda: Tagger(library, options), "tags")


if __name__ == "__main__":
    sys.exit(main())
