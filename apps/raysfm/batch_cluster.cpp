#include "batch_cluster.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "batch_list.h"

namespace raysfm::app {
namespace {

constexpr int kMostTasks = 1000;  // a job array of Slurm has no more unless it is configured to

// A text as Python and JSON write it.
std::string python_text(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

}  // namespace

std::string slurm_script(const ClusterBatch& batch) {
  const int tasks = std::min(batch.jobs, kMostTasks);
  return fmt::format(R"(#!/bin/bash
#SBATCH --job-name=raysfm
#SBATCH --array=1-{0}
#SBATCH --cpus-per-task=1
#SBATCH --output=/dev/null
# sbatch --wait THIS; every option of sbatch may be given before it, e.g. --cpus-per-task=4 or --time=2:00:00.
exec {1} batch {2} --out {3} --part "$SLURM_ARRAY_TASK_ID/{0}" --jobs 1 --threads "${{SLURM_CPUS_PER_TASK:-1}}"
)",
                     tasks, shell_quoted(batch.program.string()), shell_quoted(batch.list.string()),
                     shell_quoted(batch.folder.string()));
}

std::string dask_script(const ClusterBatch& batch) {
  return fmt::format(R"(#!/usr/bin/env python3
"""THIS [SCHEDULER]: runs the videos of a list on the cluster of a Dask scheduler, e.g. tcp://head:8786, or on this machine."""
import subprocess
import sys

from dask.distributed import Client, LocalCluster, as_completed

PROGRAM, LIST, FOLDER, JOBS = {}, {}, {}, {}


def run(job):
    command = [PROGRAM, "batch", LIST, "--out", FOLDER, "--part", f"{{job}}/{{JOBS}}", "--jobs", "1", "--threads", "1", "--quiet"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.returncode, done.stdout


def main():
    cluster = sys.argv[1] if len(sys.argv) > 1 else LocalCluster(threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        codes = []
        for _, (code, said) in as_completed(client.map(run, range(1, JOBS + 1), pure=False), with_results=True):
            sys.stderr.write(said)
            codes.append(code)
    sys.exit(max(codes))


if __name__ == "__main__":
    main()
)",
                     python_text(batch.program.string()), python_text(batch.list.string()),
                     python_text(batch.folder.string()), batch.jobs);
}

}  // namespace raysfm::app
