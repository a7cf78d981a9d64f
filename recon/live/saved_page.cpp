// SPDX-License-Identifier: MIT
#include "recon/live/saved_page.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "acquire/record/deflate.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"
#include "recon/live/http.hpp"

namespace echofuse::view {
namespace {

using Json = nlohmann::json;
constexpr int level = 9;
constexpr std::size_t max_doubtful = 8;

std::string base64(const Bytes& bytes) {
  constexpr std::string_view digits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < n ? bytes[i + k] : 0U);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? digits[group >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

// Returns a line of the page: the message, compressed and in base64; empty for a null message.
std::string line_of(const Message& message) {
  return message ? base64(record::deflated(*message, level)) + "\n" : "";
}

// Replaces each link to a file of the page by its contents, e.g. <script src="view.js"></script>.
// Only these scripts and styles have the nonce, so the browser runs no others.
std::string with_files(std::string page, const std::string& nonce) {
  struct Kind {
    std::string_view begin, end, tag;
  };
  for (const Kind& kind : {Kind{"<script src=\"", "</script>", "script"},
                           Kind{"<link rel=\"stylesheet\" href=\"", ">", "style"}})
    for (std::size_t at = 0; (at = page.find(kind.begin, at)) != page.npos;) {
      const std::size_t name = at + kind.begin.size();
      const PageFile* file =
          page_file(std::string_view(page).substr(name, page.find('"', name) - name));
      const std::string tag(kind.tag);
      const std::string text =
          "<" + tag + " nonce=\"" + nonce + "\">" + std::string(file->contents) + "</" + tag + ">";
      page.replace(at, page.find(kind.end, name) + kind.end.size() - at, text);
      at += text.size();
    }
  return page;
}

Message record_or_reason(RunMessages& messages, std::int64_t index) {
  try {
    return messages.record(index, false);
  } catch (const Error& e) {
    return trouble(printable(e.what(), 300));
  }
}

void insert_before(std::string& page, std::string_view place, const std::string& text) {
  page.insert(page.find(place), text);
}

// Returns the records in the order of their importance, without repetitions: those that are listed,
// the first and the last one, then the ones that the thumbnails show.
std::vector<std::int64_t> chosen(const RunMessages& messages,
                                 const std::vector<std::int64_t>& listed) {
  const auto& all = messages.run().outlines();
  std::vector<std::int64_t> out, indices, doubtful, rest;
  const auto add = [&](std::int64_t index) {
    if (std::ranges::find(out, index) == out.end()) out.push_back(index);
  };
  for (const std::int64_t index : listed) {
    if (std::ranges::find(all, index, &Outline::index) == all.end())
      throw Error(ExitCode::usage, "--records " + std::to_string(index) + ": the run has " +
                                       std::to_string(all.size()) +
                                       " records, and none has this number");
    add(index);
  }
  if (all.empty()) return out;
  add(all.back().index), add(all.front().index);
  for (const std::int64_t index : messages.worst_and_median()) add(index);
  for (const Outline& o : all) {
    indices.push_back(o.index);
    if (o.doubtful) doubtful.push_back(o.index);
  }
  for (const std::int64_t index : spread(doubtful, max_doubtful)) add(index);
  for (const std::int64_t index : spread(indices, sheet_maps))
    if (std::ranges::find(out, index) == out.end()) rest.push_back(index);
  const std::size_t free = max_saved_records - std::min(max_saved_records, out.size());
  for (const std::int64_t index : spread(rest, free)) add(index);
  out.resize(std::min(out.size(), max_saved_records));
  return out;
}

}  // namespace

std::string saved_page(RunMessages& messages, const std::vector<std::int64_t>& listed) {
  FollowedRun& run = messages.run();
  run.refresh();
  if (!run.trouble().empty()) throw Error(ExitCode::failed, run.trouble());
  const std::string nonce = make_token();
  std::string page = with_files(std::string(page_file("index.html")->contents), nonce);
  insert_before(page, "<meta name=\"viewport\"",
                "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; "
                "script-src 'nonce-" +
                    nonce + "'; style-src 'nonce-" + nonce +
                    "'; img-src data:; base-uri 'none'; form-action 'none'\">\n");
  std::string whole = line_of(messages.about_run(false)) + line_of(messages.state()) +
                      line_of(messages.reference()) + line_of(messages.strip()),
              records;
  const auto& all = run.outlines();
  if (!all.empty()) whole += line_of(messages.sheet(all.front().index, all.back().index));
  Json kept = Json::array();
  for (const std::int64_t index : chosen(messages, listed)) {
    const std::string line = line_of(record_or_reason(messages, index));
    if (page.size() + whole.size() + records.size() + line.size() > max_saved_bytes) break;
    records += line;
    kept.push_back(index);
  }
  const Message about = MessageWriter().finish(
      {{"kind", "saved"}, {"utc", iso8601(messages.now())}, {"records", kept}, {"of", all.size()}});
  insert_before(page, "<script nonce",
                "<!--\n" + std::string(page_file("uPlot.LICENSE")->contents) +
                    "-->\n<script type=\"text/plain\" id=\"messages\">" + line_of(about) + records +
                    whole + "</script>\n");
  return page;
}

}  // namespace echofuse::view
