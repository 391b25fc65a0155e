// The versions of glibc's functions the core asks for, where it has had newer ones since 2.28: a core built on a new system
// then loads on one from 2018 on. CMakeLists.txt includes this file in front of every source file.
//
// glibc 2.29 and 2.35 gave `exp`, `pow` and `hypot` new versions for what happens to errno, which nobody here reads. Both versions
// compute with the same function of the libm that is loaded (tests/native/test_portability.py compares them bit by bit).
#pragma once
#if defined(__linux__)
#include <features.h>
#endif

#if defined(__GLIBC__) && defined(__x86_64__)
__asm__(".symver exp, exp@GLIBC_2.2.5");
__asm__(".symver pow, pow@GLIBC_2.2.5");
__asm__(".symver hypot, hypot@GLIBC_2.2.5");
#elif defined(__GLIBC__) && defined(__aarch64__)
__asm__(".symver exp, exp@GLIBC_2.17");
__asm__(".symver pow, pow@GLIBC_2.17");
__asm__(".symver hypot, hypot@GLIBC_2.17");
#endif
