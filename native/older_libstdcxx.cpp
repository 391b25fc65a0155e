// What the headers of GCC 11 and later call inline and older libstdc++ has not, from what all of them since GCC 4.9 have:
// a core built by a new compiler then loads beside an old libstdc++. (The compilers of the manylinux images link the same in.)
// An exception_ptr is one pointer to a counted object: its copy constructor counts up, its destructor down.
#include <new>

#if defined(__GLIBCXX__) && defined(__linux__)
extern "C" {
void copy_construct(void* place, void* const* pointer) __asm__("_ZNSt15__exception_ptr13exception_ptrC1ERKS0_");
void destroy(void** pointer) __asm__("_ZNSt15__exception_ptr13exception_ptrD1Ev");

[[gnu::visibility("hidden")]] void add_reference(void** self) __asm__("_ZNSt15__exception_ptr13exception_ptr9_M_addrefEv");
[[gnu::visibility("hidden")]] void release(void** self) __asm__("_ZNSt15__exception_ptr13exception_ptr10_M_releaseEv");
[[gnu::visibility("hidden"), noreturn]] void throw_bad_length() __asm__("_ZSt28__throw_bad_array_new_lengthv");

void add_reference(void** self) {
  void* another;
  copy_construct(&another, self);
}

void release(void** self) {
  destroy(self);
  *self = nullptr;
}

void throw_bad_length() { throw std::bad_array_new_length(); }
}
#endif
