// SPDX-License-Identifier: MIT
#include "drivers/util/printable.hpp"

#include "../catch.hpp"
#include "drivers/util/console.hpp"

TEST_CASE("printable() converts any string to one line of valid UTF-8 without control characters") {
  CHECK(printable("letter:A \xc3\xa9 \xe2\x82\xac \xf0\x9f\x98\x80 \\") ==
        "letter:A \xc3\xa9 \xe2\x82\xac \xf0\x9f\x98\x80 \\");
  CHECK(printable(std::string("a\0b\x1b[2J\r\n\t\x7f", 11)) == "a\\x00b\\x1b[2J\\x0d\\n\\t\\x7f");
  CHECK(printable("\xc2\x9b"
                  "31m \xe2\x80\xae"
                  "cod.exe \xe2\x80\xa8") == "\\u009b31m \\u202ecod.exe \\u2028");
  // Sequences that RFC 3629 forbids: an overlong form, a surrogate, a code point beyond U+10FFFF, a
  // truncated sequence and a lone continuation byte.
  CHECK(printable("\xc0\xaf \xe0\x80\xaf \xed\xa0\x80 \xf4\x90\x80\x80 \xe2\x82 \x80") ==
        "\\xc0\\xaf \\xe0\\x80\\xaf \\xed\\xa0\\x80 \\xf4\\x90\\x80\\x80 \\xe2\\x82 \\x80");
  CHECK(printable("\xf0\x9f\x98") == "\\xf0\\x9f\\x98");
  CHECK(printable(std::string(100, 'x'), 10) == "xxxxxxxxxx...");
  CHECK(printable("xx\xe2\x82\xac", 3) == "xx\xe2\x82\xac");
  CHECK(printable_lines("a\n\x1b") == "a\n\\x1b");
  CHECK(utf8_text("a\n\x1b\xff \xc3\xa9") == "a\n\x1b\\xff \xc3\xa9");
}

TEST_CASE("a string in a CSV table cannot start a new cell or a formula") {
  CHECK(csv_text("ok") == "\"ok\"");
  CHECK(csv_text("") == "\"\"");
  CHECK(csv_text("a \"b\", c\nd") == "\"a \"\"b\"\", c\nd\"");
  CHECK(csv_text("=1+1") == "\"'=1+1\"");
  CHECK(csv_text("@SUM(1)") == "\"'@SUM(1)\"");
  CHECK(csv_text("-1 m") == "\"'-1 m\"");
}

TEST_CASE("a wrapped line is continued at the indentation of its text") {
  CHECK(wrapped("ok       disk rate     64 MB/s in commits of 262 kB\n", 40) ==
        "ok       disk rate     64 MB/s in\n         commits of 262 kB\n");
  CHECK(wrapped("  a name of more than twenty  letters and a text\nshort", 40) ==
        "  a name of more than twenty  letters\n    and a text\nshort\n");
  const std::string path(60, 'x');
  CHECK(wrapped("run  " + path + " and so on", 40) == "run  " + path + "\n     and so on\n");
  for (std::size_t columns = 1; columns < 60; ++columns) {
    std::string words =
        wrapped("  --out RUN REQUIRED    run file to make, never overwritten", columns);
    CHECK(std::count(words.begin(), words.end(), ' ') >= 6);
    words.erase(std::remove_if(words.begin(), words.end(), ::isspace), words.end());
    CHECK(words == "--outRUNREQUIREDrunfiletomake,neveroverwritten");
  }
}

TEST_CASE("a progress line fits the terminal width") {
  const std::string title = "training", counts = "7/60  ETA 3 s",
                    text = counts + "  validation 0.065 of the spread";
  const auto line = [&](std::size_t columns) {
    return progress_line(title, 0.5, counts, text, columns);
  };
  CHECK(line(200) == title + " [" + std::string(15, '#') + std::string(15, '.') + "] " + text);
  for (std::size_t columns = 1; columns < 120; ++columns) CHECK(line(columns).size() <= columns);
  CHECK(line(70).find(text) != std::string::npos);
  CHECK(line(60).find(text) == std::string::npos);
  CHECK(line(40) == title + " [#######........] 7/60  ETA 3 s");
  CHECK(line(24) == title + " " + counts);
}
