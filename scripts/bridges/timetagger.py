#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the tags of a Swabian Instruments Time Tagger over the echofuse bridge protocol, through the
vendor's own Python library. echofuse connects with tdc.address = "bridge:tcp://HOST:PORT"."""
import argparse
import importlib
import sys

import bridge
from bridge import np

RECORD = [("type", "u1"), ("reserved", "u1"), ("missed", "<u2"), ("channel", "<i4"), ("time", "<i8")]
BLOCK_TAGS = 65536           # 1 MiB: what one damaged block costs
MOST_EVENTS = (1 << 28) - 1  # the library's limit

FILTER_HELP = """\
conditional filter: every photon lets one laser pulse through, the first that reaches the filter after
it; the others stay in the device, so that the photon rate and not the laser rate loads the USB. But
that pulse comes AFTER the photon, while the histogram counts from the last pulse BEFORE it. With
  --conditional-filter PS
the sync is therefore delayed by PS in hardware, in front of the filter, and by -PS in software, behind
it: the pulse that made the photon passes, and the tags keep their true times. PS must be longer than
the longest time of flight of interest and shorter than the laser's period; 7 m and 20 MHz: 48000.
A device without hardware delays (Time Tagger 20) needs a cable of that delay in the sync line
instead: --conditional-filter 0 --input-delay START=-PS. While the filter is on, every --input-delay is
made in software, behind it. Never use --event-divider on the sync together with it."""


def setting(kind, low, high):
    """CH=VALUE, for argparse."""
    parse_value = bridge.number(kind, low, high)

    def parse(text):
        channel, equals, value = text.partition("=")
        try:
            return int(channel), parse_value(value)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not CH=VALUE") from None
    return parse


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(description=__doc__, epilog=FILTER_HELP,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    number = bridge.number
    add = parser.add_argument
    add("--listen", metavar="HOST:PORT", type=bridge.listen_address, default=("127.0.0.1", 41110),
        help="where echofuse connects (127.0.0.1:41110); there is no password: keep it in the laboratory")
    add("--serial", default="", help="of the device; without it, the first one")
    add("--start-channel", metavar="CH", type=number(int, -99, 99), default=1,
        help="laser sync (1); negative for the falling edge")
    add("--click-channel", metavar="CH", type=number(int, -99, 99), default=2, help="detector (2)")
    per_channel = dict(action="append", default=[])
    add("--trigger-level", metavar="CH=V", type=setting(float, -5, 5), **per_channel,
        help="repeatable, as are the next three; a negative channel needs the form --trigger-level=-2=0.5")
    add("--input-delay", metavar="CH=PS", type=setting(int, -10**12, 10**12), **per_channel)
    add("--dead-time", metavar="CH=PS", type=setting(int, 0, 10**12), **per_channel,
        help="the device rounds it; what it really uses is printed")
    add("--event-divider", metavar="CH=N", type=setting(int, 1, 65535), **per_channel,
        help="keep every N-th event")
    add("--conditional-filter", metavar="PS", type=number(int, 0, 2_000_000), help="see below")
    add("--test-signal", action="store_true", help="the built-in test signal on both channels")
    add("--max-events", metavar="N", type=number(int, 1000, MOST_EVENTS), default=1 << 24,
        help="buffer of the library (16777216); more within --block-ms are lost, and counted as one")
    add("--block-ms", metavar="MS", type=number(float, 1, 500), default=20.0, help="how often tags are sent (20)")
    options = parser.parse_args(arguments)
    used = {abs(options.start_channel), abs(options.click_channel)}
    if options.start_channel == options.click_channel or 0 in used:
        parser.error("--start-channel and --click-channel must be two channels other than 0")
    for name in ("trigger_level", "input_delay", "dead_time", "event_divider"):
        for channel, _ in getattr(options, name):
            if abs(channel) not in used:
                parser.error(f"--{name.replace('_', '-')}: channel {channel} is neither start nor click")
    if options.conditional_filter is not None and any(abs(c) == abs(options.start_channel)
                                                      for c, _ in options.event_divider):
        parser.error("--event-divider on the start channel does not go with --conditional-filter: it would drop the "
                     "pulses that the filter lets through")
    return options


class Tagger:
    """An open device with its stream."""

    def __init__(self, library, options):
        self._library, self._options = library, options
        self._told_full = False
        self._stream = None
        self._tagger = library.createTimeTagger(*filter(None, [options.serial]))
        try:
            self._configure()
            self._stream = library.TimeTagStream(self._tagger, options.max_events,
                                                 [options.start_channel, options.click_channel])
        except Exception:
            self.close()
            raise

    def _configure(self):
        tagger, options = self._tagger, self._options
        for channel in (options.start_channel, options.click_channel):
            tagger.setTestSignal(channel, options.test_signal)
        for channel, volts in options.trigger_level:
            tagger.setTriggerLevel(channel, volts)
        self._set_delays()
        for channel, asked_ps in options.dead_time:
            bridge.say(f"dead time of channel {channel}: {tagger.setDeadtime(channel, asked_ps)} ps "
                       f"(asked for {asked_ps})")
        filtered = options.conditional_filter is not None
        tagger.setConditionalFilter([options.click_channel] if filtered else [],
                                    [options.start_channel] if filtered else [])
        for channel, divider in options.event_divider:
            tagger.setEventDivider(channel, divider)
        tagger.sync()  # what comes from here on was taken with these settings

    def _set_delays(self):
        tagger, start = self._tagger, self._options.start_channel
        delays = dict(self._options.input_delay)
        ahead_ps = self._options.conditional_filter
        if ahead_ps is None:
            for channel, delay_ps in delays.items():
                tagger.setInputDelay(channel, delay_ps)
            return
        if ahead_ps > 0:
            tagger.setDelayHardware(start, ahead_ps)
        delays[start] = delays.get(start, 0) - ahead_ps
        for channel, delay_ps in delays.items():
            tagger.setDelaySoftware(channel, delay_ps)

    def hello(self):
        tagger = self._tagger
        firmware = tagger.getFirmwareVersion() if hasattr(tagger, "getFirmwareVersion") else ""
        return {"model": tagger.getModel(), "serial": tagger.getSerial(), "firmware": " ".join(firmware.split())}

    def poll(self, server):
        if not self._stream.isRunning():
            raise RuntimeError("the tag stream has stopped")
        data = self._stream.getData()
        if data.size > 0:
            self._send(data, server)
        if data.size >= self._options.max_events:
            self._overrun(server)
            return 0
        return self._options.block_ms * 1e-3

    def _send(self, data, server):
        columns = (data.getEventTypes(), data.getMissedEvents(), data.getChannels(), data.getTimestamps())
        for first in range(0, data.size, BLOCK_TAGS):
            part = slice(first, min(first + BLOCK_TAGS, data.size))
            tags = np.zeros(part.stop - part.start, RECORD)
            for name, column in zip(("type", "missed", "channel", "time"), columns):
                tags[name] = column[part]
            server.send(bridge.TAGS, tags.view(np.uint8).data, len(tags))

    def _overrun(self, server):
        server.lose(1)  # how many the library threw away it does not say
        if not self._told_full:
            bridge.say("the library's buffer was full and tags are lost: raise --max-events or lower --block-ms")
        self._told_full = True

    def close(self):
        if self._stream is not None:
            self._stream.stop()
        self._stream = None
        self._library.freeTimeTagger(self._tagger)


def import_library():
    """Newer versions come as Swabian.TimeTagger, older ones as TimeTagger."""
    faults = []
    for name in ("Swabian.TimeTagger", "TimeTagger"):
        try:
            return importlib.import_module(name)
        except ImportError as error:
            faults.append(str(error))
    bridge.fail(f"{'; '.join(dict.fromkeys(faults))}; install the Time Tagger software of Swabian Instruments for this "
                "Python")


def main():
    options = parse_arguments(sys.argv[1:])
    bridge.require_packages()
    library = import_library()
    return bridge.run(options.listen, lambda: Tagger(library, options), "tags")


if __name__ == "__main__":
    sys.exit(main())
