// All the memory one caller needs, and the pool that lends it: a kernel is immutable, so threads meet only at the lock.
#pragma once
#include "derivatives.hpp"
#include "motors.hpp"
#include "regressor.hpp"
#include "terms.hpp"

#include <memory>
#include <mutex>

namespace ccpin {

struct Workspace {
  ReducedModel model;
  Terms terms;
  Derivatives derivatives;
  Motors motors;
  Regressor regressor;
  explicit Workspace(const Mechanism& m) : model(m), terms(model), derivatives(model), motors(model), regressor(model) {}
};

class Pool {
 public:
  explicit Pool(const Mechanism& m) : m_(m) {}

  class Lease {
   public:
    explicit Lease(Pool& pool) : pool_(pool), space_(pool.take()) {}
    ~Lease() { pool_.give(std::move(space_)); }
    Lease(const Lease&) = delete;
    Workspace* operator->() { return space_.get(); }
    Workspace& operator*() { return *space_; }

   private:
    Pool& pool_;
    std::unique_ptr<Workspace> space_;
  };

 private:
  const Mechanism& m_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Workspace>> idle_;

  std::unique_ptr<Workspace> take() {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (!idle_.empty()) {
        auto space = std::move(idle_.back());
        idle_.pop_back();
        return space;
      }
    }
    return std::make_unique<Workspace>(m_);
  }
  void give(std::unique_ptr<Workspace> space) {
    std::lock_guard<std::mutex> lock(mutex_);
    idle_.push_back(std::move(space));
  }
};

}  // namespace ccpin
