// SPDX-License-Identifier: MIT
#include "acquire/devices/device_check.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquire/record/run_reader.hpp"
#include "drivers/depth/openni_camera.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

// Reads the state and the sample counts of the device from the last record of the run, and adds
// them to `out`.
void take_last_record(const std::string& file, const Clock& clock, Answer& out) {
  const record::RunReader run(file);
  const std::int64_t last = run.summary().last_index;
  if (const std::string status = run.info().status; status != "open") {
    out.text += "; its run is " + printable(status);
  } else if (last < 0) {
    out.text += "; its run has no record yet";
  } else {
    const record::FusedRecord r = run.read(last);
    const auto& sync = r.sync[out.sensor];
    const double age_s = seconds(clock.utc() - r.slot_utc) - seconds(r.slot_end - r.slot_start);
    out.delivers = r.has(out.sensor);
    out.text += "; record " + std::to_string(r.index) + ", " +
                human_duration(std::max(age_s, 0.0)) + " ago: " + printable(sync.text()) + ", " +
                std::to_string(sync.used) + (out.sensor == Sensor::spd ? " clicks" : " frames") +
                " used, " + std::to_string(sync.lost) + " lost";
  }
}

Answer answer_of_holder(Answer out, const Clock& clock) {
  const Holder& holder = *out.status.holder;
  out.text = "in use by " + holder.who;
  out.delivers = false;
  std::error_code none;
  if (!std::filesystem::is_regular_file(holder.run, none)) {
    if (!holder.run.empty()) out.text += "; its run file does not exist yet";
    return out;
  }
  try {
    take_last_record(holder.run, clock, out);
  } catch (const Error& e) {
    out.text += std::string("; ") + printable(e.what());
  }
  return out;
}

std::string field(const Json& object, const char* key) {
  return printable(object[key].get<std::string>());
}

// Returns "model A, serial B, firmware C"; unknown parts are omitted.
std::string names_of(const Json& device) {
  std::string text;
  for (const char* key : {"model", "serial", "firmware"})
    if (const std::string name = field(device, key); !name.empty())
      text.append(text.empty() ? "" : ", ").append(key).append(" ").append(name);
  return text;
}

// Returns all attached devices as {"usb": [...], "openni": [...]}.
Json find_attached(std::string& camera_fault) {
  Json usb = Json::array(), cameras = Json::array();
  for (const auto& device : inventory::list_attached()) {
    Json nodes = Json::array();
    for (const auto& node : device.nodes)
      nodes.push_back({{"node", node.path},
                       {"key", node.key},
                       {"address", node.address},
                       {"missing", node.missing}});
    usb.push_back({{"kind", device.kind},
                   {"id", format("%04x:%04x", unsigned{device.vendor}, unsigned{device.product})},
                   {"model", device.model},
                   {"serial", device.serial},
                   {"firmware", device.firmware},
                   {"advice", device.advice},
                   {"nodes", nodes}});
  }
  try {
    for (const auto& camera : depth::list_openni_devices())
      cameras.push_back({{"model", camera.model}, {"address", "openni:" + camera.uri}});
  } catch (const Error& e) {
    camera_fault = e.what();
  }
  return {{"usb", usb}, {"openni", cameras}};
}

// Formats the attached devices as text, with the lines to copy into lab.toml.
std::string text_of(const Json& attached, const std::string& camera_fault) {
  std::string text;
  const auto setting = [&](const std::string& key, const Json& node) {
    text += "  " + key + " = " + printable(in_quotes(node["address"].get<std::string>())) + '\n';
  };
  for (const Json& device : attached["usb"]) {
    text += field(device, "kind") + ' ' + field(device, "id") + ": " + names_of(device) + '\n';
    if (const auto advice = field(device, "advice"); !advice.empty()) text += "  " + advice + '\n';
    for (const Json& node : device["nodes"]) {
      const std::string key = field(node, "key"), missing = field(node, "missing");
      if (!field(node, "address").empty()) setting(key, node);
      if (!missing.empty()) text += "  " + (key.empty() ? "" : key + ": ") + missing + '\n';
    }
  }
  for (const Json& camera : attached["openni"]) {
    text += "OpenNI2 camera: model " + field(camera, "model") + '\n';
    setting("depth.address", camera);
  }
  if (!camera_fault.empty()) text += printable(camera_fault) + '\n';
  return text.empty() ? "no supported device is attached\n" : text;
}

Json to_json(const Answer& answer) {
  const auto& [sensor, status, delivers, text] = answer;
  return {{"sensor", name_of(sensor)},
          {"address", status.info.address},
          {"state", status.holder ? "in use" : name_of(status.state)},
          {"answers", delivers},
          {"model", status.info.model},
          {"serial", status.info.serial},
          {"firmware", status.info.firmware},
          {"samples", status.samples},
          {"last_event", status.holder ? text : status.last_event},
          {"run", status.holder ? status.holder->run : ""}};
}

std::string text_of(const Answer& answer) {
  const Devices::Status& status = answer.status;
  if (!status.holder && !answer.delivers) return answer.text;
  return std::string(name_of(answer.sensor)) + " " + printable(status.info.address) + ": " +
         (status.holder
              ? answer.text
              : "answers; " + names_of(to_json(answer)) + ", " + std::to_string(status.samples) +
                    (answer.sensor == Sensor::spd ? " tags" : " frames") + " so far");
}

}  // namespace

std::vector<Answer> ask(const Config& config, port::Loop& loop, const std::string& command,
                        SampleSink& sink, const std::function<void(const Devices&)>& listen) {
  Devices devices(loop, config, sink);
  devices.take_free(command);
  devices.start();
  devices.wait(config.connect_timeout_s);
  if (listen && !devices.all([](const auto& device) { return device.holder.has_value(); }))
    listen(devices);
  std::vector<Answer> answers;
  for (const Sensor s : all_sensors) {
    if (!devices[s].configured) continue;
    answers.push_back({s, devices[s], devices[s].delivers(), devices.describe(s)});
    if (devices[s].holder) answers.back() = answer_of_holder(answers.back(), loop);
  }
  return answers;
}

ExitCode list_devices(const std::optional<Config>& config, port::Loop& loop, bool json) {
  std::string camera_fault;
  Json all{{"schema", 1},
           {"configured", Json::array()},
           {"attached", find_attached(camera_fault)},
           {"instructions", instruction_set()}};
  if (!json) print(text_of(all["attached"], camera_fault));
  if (!json) print("processor: " + instruction_set());
  std::fflush(stdout);
  SampleSink no_sink;
  bool ok = true;
  for (const Answer& answer :
       config ? ask(*config, loop, "devices", no_sink) : std::vector<Answer>{}) {
    ok = ok && answer.delivers;
    all["configured"].push_back(to_json(answer));
    if (!json) print(text_of(answer));
  }
  if (json)  // device strings may contain invalid UTF-8
    std::printf("%s\n", all.dump(2, ' ', true, Json::error_handler_t::replace).c_str());
  return ok ? ExitCode::ok : ExitCode::device;
}

}  // namespace echofuse::acquire
