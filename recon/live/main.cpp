// SPDX-License-Identifier: MIT
// echofuse-view: shows a live or finished run in a browser.
#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>

#include "acquire/record/run_names.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/printable.hpp"
#include "recon/live/saved_page.hpp"
#include "recon/live/server.hpp"
#include "recon/numbers/parallel.hpp"

namespace {
using namespace echofuse;
using namespace echofuse::view;

struct Options {
  std::string model, save;
  std::vector<std::int64_t> records;  // records of a saved page
  ServerOptions server;
  bool quiet = false;
};

// Redirects the standard streams to /dev/null, because the parent process may wait until they are
// closed.
void leave_terminal() {
  const int none = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (none >= 0) ::dup2(none, stream);
  std::signal(SIGINT, SIG_IGN);  // ignores Ctrl-C, which is meant for the acquisition program
}

ExitCode show(const Options& o) {
  catch_interrupts();
  recon::set_threads(1);
  const SystemClock clock;
  std::optional<LiveModel> model;
  try {
    if (!o.model.empty()) model.emplace(o.model);
  } catch (const Error& e) {
    if (!o.server.until_closed) throw;
    // Continues without a model, because the page is useful even without reconstructions.
    std::fprintf(stderr, "echofuse-view: %s; the page shows no reconstructions\n",
                 printable(e.what()).c_str());
  }
  if (!o.save.empty()) {
    if (!std::filesystem::is_directory(o.server.run))
      static_cast<void>(record::RunReader(record::old_run(o.server.run)));
    FollowedRun run(o.server.run);
    RunMessages messages(run, model ? &*model : nullptr, o.server.planned, clock);
    write_atomically(o.save, saved_page(messages, o.records));
    std::printf("%s\n", printable(o.save).c_str());
    return ExitCode::ok;
  }
  Server server(o.server, model ? &*model : nullptr, clock);
  if (!o.server.until_closed)
    if (const std::string why = server.missing(); !why.empty())
      std::fprintf(stderr, "echofuse-view: %s\n", printable(why).c_str());
  std::printf("%s\n", server.address().c_str());
  std::fflush(stdout);
  if (o.server.until_closed) leave_terminal();
  server.run();
  return ExitCode::ok;
}

int run(int argc, char** argv) {
  Options o;
  CLI::App app("show a live or finished run in a browser, or list the runs of a folder",
               "echofuse-view");
  app.set_version_flag("--version", version_line("echofuse-view"));
  app.add_option("RUN", o.server.run, "run file, or folder of runs")->type_name("RUN")->required();
  app.add_option("--model", o.model, "model file for the depth maps that the page shows")
      ->type_name("MODEL");
  CLI::Option* const save =
      app.add_option("--save", o.save,
                     "save the page as one HTML file for any browser and for print, then exit; it "
                     "contains at most 40 records")
          ->type_name("FILE.html");
  app.add_option("--records", o.records, "records that the saved page must contain, e.g. 3,7")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->needs(save);
  app.add_option("--listen", o.server.listen,
                 "ADDRESS:PORT to listen on (default: 127.0.0.1:8410, or a free port if 8410 is in "
                 "use); browsers on other machines need the printed token");
  app.add_option("--planned", o.server.planned,
                 "planned number of records; the page shows the number of remaining records")
      ->check(CLI::PositiveNumber);
  app.add_flag("--until-closed", o.server.until_closed,
               "exit when the run has ended and no browser is connected");
  app.add_flag("-q,--quiet", o.quiet, "print errors only");
  more_options(app, {"--records", "--planned", "--until-closed", "--quiet"});
  add_examples(app,
               {"echofuse-view monday.sqlite", "echofuse-view --save monday.html monday.sqlite",
                "echofuse-view . --model fused.safetensors"});
  try {
    parse_command_line(app, argc, argv);
  } catch (const CLI::ParseError& e) {
    return run_main("echofuse-view",
                    [&] { return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage; });
  }
  return run_main("echofuse-view", [&] { return show(o); });
}

}  // namespace

int main(int argc, char** argv) { return run(argc, argv); }
