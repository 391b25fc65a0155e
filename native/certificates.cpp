// The part of ccpin.native._core that certifies boxes: Certifier and contacts, described in _core.pyi.
#include "certifier.hpp"
#include "contacts.hpp"

static int import_numpy() {
  import_array1(-1);
  return 0;
}

void bind_certificates(nb::module_& module) {
  using ccpin::certificates::Certifier;
  using nb::arg;
  if (import_numpy() < 0) throw nb::python_error();
  nb::class_<Certifier>(module, "Certifier")
      .def(nb::init<nb::dict>(), arg("numbers"))
      .def("values", &Certifier::values, arg("theta"))
      .def("derivatives", &Certifier::derivatives, arg("theta"))
      .def("bounds", &Certifier::bounds, arg("boxes"))
      .def("newton", &Certifier::newton, arg("theta"), arg("iterations"), arg("accuracy"))
      .def("certify_boxes", &Certifier::certify_boxes, arg("centre"), arg("half"), arg("across"))
      .def("certify_points", &Certifier::certify_points, arg("theta"))
      .def("glued", &Certifier::glued, arg("first"), arg("delta"), arg("second"), arg("delta_second"));
  module.def(
      "contacts",
      [](nb::handle lower, nb::handle size, nb::handle cut, nb::handle child, nb::handle cells,
         std::vector<bool> wrapped) {
        return ccpin::certificates::Contacts(lower, size, cut, child, cells, std::move(wrapped)).find();
      },
      arg("lower"), arg("size"), arg("cut"), arg("child"), arg("cells"), arg("wrapped"));
}
