#pragma once

#include <filesystem>
#include <string>

namespace raysfm::app {

// What a cluster is to run: `jobs` videos of a list.
struct ClusterBatch {
  std::filesystem::path program, list, folder;  // absolute
  int jobs = 0;
};

// A script for sbatch: a job array of at most 1000 tasks.
std::string slurm_script(const ClusterBatch& batch);

// A script for Python with dask.distributed: one task for each video.
std::string dask_script(const ClusterBatch& batch);

}  // namespace raysfm::app
