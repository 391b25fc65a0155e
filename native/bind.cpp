// The Python module ccpin.native._core: two classes, described in _core.pyi.
#include "kernel.hpp"

void bind_certificates(nb::module_& module);  // certificates.cpp

static int import_numpy() {
  import_array1(-1);
  return 0;
}

NB_MODULE(_core, module) {
  using ccpin::Kernel, ccpin::HeldMotion;
  const auto arg = [](const char* name) { return nb::arg(name).none(); };  // None fits no shape: the kernel declines
  if (import_numpy() < 0) throw nb::python_error();
#ifdef NDEBUG
  // What a daemon thread still holds when the interpreter ends is never freed: Python leaves its frames alone. nanobind would
  // tell the user of a leak of the binding's for each kernel among it.
  nb::set_leak_warnings(false);
#endif
  const auto near = arg("near");
  const auto q = arg("q") = nb::none();
  const auto wrenches = arg("wrenches") = nb::none();
  const auto threads = nb::arg("threads") = 1;
  nb::class_<Kernel>(module, "Kernel")
      .def(nb::init<nb::dict>(), nb::arg("specification"))
      .def("__reduce__", [](nb::handle self) {
        return nb::make_tuple(self.type(), nb::make_tuple(nb::cast<const Kernel&>(self).numbers));
      })
      .def("constraints", &Kernel::constraints, arg("q_free"))
      .def("constraint_rate", &Kernel::constraint_rate, arg("q_free"), arg("v_free"))
      .def("sigma", &Kernel::sigma, arg("q"), arg("near") = nb::none())
      .def("closed_point", &Kernel::closed_point, near, q)
      .def("blocked", &Kernel::blocked, near, arg("q"))
      .def("rcond", &Kernel::rcond, arg("q_free"))
      .def("terms", &Kernel::terms, near, arg("v"), q)
      .def("forward_dynamics", &Kernel::forward_dynamics, near, arg("v"), arg("u"), q, wrenches)
      .def("generalized_force", &Kernel::generalized_force, near, arg("v"), arg("a"), q, wrenches)
      .def("inverse_dynamics", &Kernel::inverse_dynamics, near, arg("v"), arg("a"), q, wrenches)
      .def("regressor", &Kernel::regressor, near, arg("v"), arg("a"), arg("v_r"), q)
      .def("gravity", &Kernel::gravity, near, q)
      .def("transmission", &Kernel::transmission, near, q)
      .def("constraint_forces", &Kernel::constraint_forces, near, arg("v"), arg("u"), q, wrenches)
      .def("bearing_forces", &Kernel::bearing_forces, near, arg("v"), arg("u"), q, wrenches)
      .def("energy", &Kernel::energy, near, arg("v"), q)
      .def("generalized_force_derivatives", &Kernel::generalized_force_derivatives, near, arg("v"), arg("a"), q, wrenches)
      .def("forward_dynamics_derivatives", &Kernel::forward_dynamics_derivatives, near, arg("v"), arg("u"), q, wrenches)
      .def("sigma_many", &Kernel::sigma_many, arg("Q"), near, threads)
      .def("terms_many", &Kernel::terms_many, arg("Q"), arg("V"), near, threads)
      .def("forward_dynamics_many", &Kernel::forward_dynamics_many, arg("Q"), arg("V"), arg("U"), near, threads)
      .def("generalized_force_many", &Kernel::generalized_force_many, arg("Q"), arg("V"), arg("A"), near, threads)
      .def("inverse_dynamics_many", &Kernel::inverse_dynamics_many, arg("Q"), arg("V"), arg("A"), near, threads)
      .def("regressor_many", &Kernel::regressor_many, arg("Q"), arg("V"), arg("A"), arg("V_r"), near, threads)
      .def("forward_dynamics_derivatives_many", &Kernel::forward_dynamics_derivatives_many, arg("Q"), arg("V"),
           arg("U"), near, threads)
      .def("simulate", &Kernel::simulate, near, nb::arg("law"), nb::arg("run"), nb::arg("tableau"),
           nb::arg("nominal").none() = nb::none(), nb::arg("nominal_near") = nb::none())
      .def("learnt", &Kernel::learnt, nb::arg("law"), nb::arg("sampling"), arg("t"), arg("Q"), arg("V"), arg("Q_free"))
      .def(
          "held_motion",
          [](Kernel& kernel, const Kernel& home, nb::dict tableau, double rtol, double atol, double longest,
             double singular, ccpin::In pushes, nb::object leaving) {
            return new HeldMotion(kernel, home, tableau, rtol, atol, longest, singular, pushes, leaving);
          },
          nb::arg("home"),
          nb::arg("tableau"), nb::arg("rtol"), nb::arg("atol"), nb::arg("max_step"), nb::arg("singular_rcond"), wrenches,
          nb::arg("leaving") = nb::none(), nb::rv_policy::take_ownership, nb::keep_alive<0, 1>(),
          nb::keep_alive<0, 2>());
  nb::class_<HeldMotion>(module, "HeldMotion")
      .def("start", &HeldMotion::start, arg("q_free"), arg("q"), arg("v"), nb::arg("first"), nb::arg("most"))
      .def("step", &HeldMotion::step, arg("u"), nb::arg("dt"))
      .def("state", &HeldMotion::state)
      .def_prop_ro("evaluations", &HeldMotion::evaluations)
      .def_prop_ro("last_step", &HeldMotion::last_step);
  bind_certificates(module);
}
