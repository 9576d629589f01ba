#pragma once

#include <ceres/iteration_callback.h>

#include <atomic>

namespace portolan {

/// Stops a Ceres solver after the current iteration once the flag is up. `stop` may be null.
class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const std::atomic<bool>* stop) : stop_(stop) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    interrupted_ = stop_ != nullptr && stop_->load(std::memory_order_relaxed);
    return interrupted_ ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }
  bool interrupted() const { return interrupted_; }

 private:
  const std::atomic<bool>* stop_;
  bool interrupted_ = false;
};

}  // namespace portolan
