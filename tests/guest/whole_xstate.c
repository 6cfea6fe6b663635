/* SPDX-License-Identifier: Apache-2.0
 *
 * For User-Mode Linux 6.1 on processors with more state than it knows of (AMX): it gets and sets the first 2696 bytes of
 * a process's extended state, but a kernel takes the whole or nothing (EFAULT). Loaded before it, this completes what
 * it sets by what the process has. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

typedef long (*Ptrace)(enum __ptrace_request, pid_t, void *, void *);

long ptrace(enum __ptrace_request request, ...)
{
	static Ptrace next;
	static char whole[1 << 16] __attribute__((aligned(64)));
	va_list arguments;
	va_start(arguments, request);
	pid_t process = va_arg(arguments, pid_t);
	void *address = va_arg(arguments, void *);
	void *data = va_arg(arguments, void *);
	va_end(arguments);

	if (!next)
		*(void **)&next = dlsym(RTLD_NEXT, "ptrace");
	if (request != PTRACE_SETREGSET || (long)address != NT_X86_XSTATE)
		return next(request, process, address, data);

	const struct iovec *known = data;
	struct iovec all = { whole, sizeof whole };
	if (next(PTRACE_GETREGSET, process, address, &all) < 0)
		return -1;
	memcpy(whole, known->iov_base, known->iov_len < all.iov_len ? known->iov_len : all.iov_len);
	return next(request, process, address, &all);
}
