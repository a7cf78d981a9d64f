#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Checks that the stand-ins have the names and arguments of the vendors' libraries.

Also checks that the bridges call only functions in the tables below. Sources of the tables:

Swabian Instruments: documentation of the Time Tagger software 2.22 ("TimeTagger classes", "Time-tag streaming", "Helper
classes"; CustomMeasurement.process(incoming_tags, begin_time, end_time) is "called whenever a new chunk of time tags is
available"). Its headers TimeTagger.h and Iterators.h declare the classes that the Python module wraps (IteratorBase: isRunning,
stop; CustomMeasurementBase: register_channel, finalize_init; TimeTagStream(tagger, n_max_events, channels)). The network and
virtual taggers are those of TimeTagger.h 2.16.2; run() exists in later versions only.

Orbbec, orbbec/pyorbbecsdk: stubs/pyorbbecsdk.pyi at commit 9fcf324. The arguments in this file have no names (arg0,
arg1, ...), so only the numbers of arguments are compared. VideoStreamProfile.get_intrinsic() and get_distortion() are
in the bindings of version 2 (src/pyorbbecsdk/stream_profile.cpp).

RealSense, IntelRealSense/librealsense: wrappers/python/pyrs_pipeline.cpp at commit 09696f9 and pyrs_frame.cpp at 005e21b,
pyrs_device.cpp, pyrs_options.cpp."""
import ast
import inspect
import re
import unittest

import testing

import pyorbbecsdk
import pyrealsense2
import TimeTagger


def table(text):
    """Returns {"Class.method" or "function": its arguments}. A line of the text begins with the class or with "module".
    The arguments are names or their number."""
    owner, out = "", {}
    for new_owner, name, listed in re.findall(r"(\w+):|(\w+)\(([\w ]*)\)", text):
        if new_owner:
            owner = "" if new_owner == "module" else new_owner + "."
        else:
            out[owner + name] = listed.split()
    return out


SWABIAN = table("""
module: createTimeTagger(serial resolution) createTimeTaggerNetwork(address)
    createTimeTaggerVirtual(filename begin duration) getVersion() scanTimeTagger() freeTimeTagger(tagger)
    setReplaySpeed(self speed) replay(self file begin duration queue)
TimeTagger: getTriggerLevel(channel) getDACRange() getModel() getSerial() getFirmwareVersion()
    setTestSignal(channel enabled) setTriggerLevel(channel voltage) setInputDelay(channel delay)
    setDelayHardware(channel delay) setDelaySoftware(channel delay) setDeadtime(channel deadtime)
    setConditionalFilter(trigger filtered hardwareDelayCompensation) setEventDivider(channel divider) sync(timeout)
TimeTaggerNetwork: isConnected() setDelayClient(channel time)
TimeTaggerVirtual: run(speed) waitForCompletion(ID timeout)
Countrate: __init__(tagger channels) startFor(capture_duration clear) waitUntilFinished(timeout) getData()
TimeTagStream: __init__(tagger n_max_events channels) isRunning() getData() stop()
TimeTagStreamBuffer: getEventTypes() getMissedEvents() getChannels() getTimestamps()
CustomMeasurement: __init__(tagger) register_channel(channel) finalize_init()
    process(incoming_tags begin_time end_time) isRunning() stop()""")

ORBBEC = table("""
Context: query_devices(0)
DeviceList: get_count(0) get_device_serial_number_by_index(1) get_device_by_serial_number(1)
Device: get_device_info(0) is_property_supported(2) set_bool_property(2) set_int_property(2)
    get_available_preset_list(0) load_preset(1) get_depth_work_mode_list(0) set_depth_work_mode(1)
DevicePresetList: get_count(0) get_name_by_index(1)
OBDepthWorkModeList: get_count(0) get_depth_work_mode_by_index(1)
DeviceInfo: get_name(0) get_serial_number(0) get_firmware_version(0)
Config: enable_stream(1)
StreamProfileList: get_video_stream_profile(4)
VideoStreamProfile: get_intrinsic(0) get_distortion(0)
Pipeline: __init__(1) get_stream_profile_list(1) start(1) stop(0) get_camera_param(0) wait_for_frames(1)
FrameSet: get_depth_frame(0)
DepthFrame: get_index(0) get_width(0) get_height(0) get_depth_scale(0) get_timestamp_us(0) get_data(0)""")

REALSENSE = table("""
context: query_devices(0)
device: get_info(1) first_depth_sensor(0)
depth_sensor: supports(1) set_option(2) get_option_range(1) get_option_value_description(2)
config: enable_device(1) enable_stream(5)
pipeline: start(1) stop(0) try_wait_for_frames(1)
pipeline_profile: get_device(0) get_stream(2)
stream_profile: as_video_stream_profile(0)
video_stream_profile: get_intrinsics(0)
composite_frame: get_depth_frame(0)
depth_frame: get_frame_number(0) get_timestamp(0) get_units(0) get_width(0) get_height(0) get_data(0)""")


def arguments(module, name):
    """Returns the argument names of a function or method, without self."""
    *owner, last = name.split(".")
    names = list(inspect.signature(getattr(getattr(module, owner[0]) if owner else module, last)).parameters)
    return names[1:] if owner else names


def calls(script, owners):
    """Returns the names of the methods that a bridge script calls on variables named in `owners`."""
    tree = ast.parse((testing.root / "scripts/bridges" / script).read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            base = node.func.value
            owner = base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "")
            if owner in owners:
                found.add(node.func.attr)
    return found


class Signatures(unittest.TestCase):
    def test_swabian_stand_in_has_the_signatures_that_the_vendor_published(self):
        for name, expected in SWABIAN.items():
            self.assertEqual(arguments(TimeTagger, name), expected, name)
        # Memory layout of a tag in the stream (documentation, "Time tag format").
        fields = {name: (str(kind), offset) for name, (kind, offset) in TimeTagger.TAG.fields.items()}
        self.assertEqual(fields, {"type": ("uint8", 0), "missed_events": ("uint16", 2), "channel": ("int32", 4),
                                  "time": ("int64", 8)})
        self.assertEqual(TimeTagger.TAG.itemsize, 16)

    def test_orbbec_stand_in_has_the_signatures_that_the_vendor_published(self):
        for name, expected in ORBBEC.items():
            self.assertEqual([str(len(arguments(pyorbbecsdk, name)))], expected, name)

    def test_realsense_stand_in_has_the_signatures_that_the_vendor_published(self):
        for name, expected in REALSENSE.items():
            self.assertEqual([str(len(arguments(pyrealsense2, name)))], expected, name)

    def test_bridges_call_only_functions_that_the_vendors_published(self):
        known = {name.split(".")[-1] for name in SWABIAN} | {"TimeTagStream", "take", "Replay", "Countrate"}
        called = calls("timetagger.py", {"library", "_library", "tagger", "_tagger", "_stream", "data"})
        self.assertEqual(called - known, set())
        self.assertGreater(len(called), 15)
        known = {name.split(".")[-1] for name in ORBBEC} | {"Context", "Config", "Pipeline"}
        called = calls("orbbec.py", {"_sdk", "sdk", "_context", "devices", "device", "info", "_pipeline", "_config",
                                     "profiles", "profile", "frames", "frame", "modes", "presets"})
        self.assertEqual(called - known, set())
        self.assertGreater(len(called), 20)
        known = {name.split(".")[-1] for name in REALSENSE} | {"context", "config", "pipeline"}
        called = calls("realsense.py", {"sdk", "_pipeline", "_config", "device", "profile", "frames", "frame", "sensor"})
        self.assertEqual(called - known, set())
        self.assertGreater(len(called), 16)


if __name__ == "__main__":
    testing.main()
