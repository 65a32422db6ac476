/*
 * Preloaded into user-mode Linux: gives it the processor's extended state in the size it expects.
 *
 * Kernels of user-mode Linux before 6.13 keep at most 2696 bytes of it for each process and hand exactly these back to
 * the computer's kernel, which since 5.14 refuses (EFAULT) anything but the whole: on processors with more
 * (AMX has 11 kB) the first process dies with "ptrace set fp regs failed, errno = 14". What lies beyond the kernel's
 * part is state that no process can have touched without asking the kernel for it first, so it is handed back as
 * zeros. On all other processors, and with newer kernels, this changes nothing.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#ifndef NT_X86_XSTATE
#define NT_X86_XSTATE 0x202
#endif

/* The kernel makes these calls from one thread, and never from a signal handler. */
static char state[1 << 16];
static size_t state_size;

static long get_state(pid_t pid, void *kind, struct iovec *caller)
{
    struct iovec whole = { state, sizeof state };
    long result = syscall(SYS_ptrace, PTRACE_GETREGSET, pid, kind, &whole);
    if (result < 0)
        return result;
    state_size = whole.iov_len;
    if (caller->iov_len > state_size)
        caller->iov_len = state_size;
    memcpy(caller->iov_base, state, caller->iov_len);
    return result;
}

static long set_state(pid_t pid, void *kind, const struct iovec *caller)
{
    struct iovec whole = { state, state_size };
    memset(state, 0, state_size);
    memcpy(state, caller->iov_base, caller->iov_len);
    return syscall(SYS_ptrace, PTRACE_SETREGSET, pid, kind, &whole);
}

long ptrace(enum __ptrace_request request, ...)
{
    static long (*next)(int, pid_t, void *, void *);
    va_list list;
    va_start(list, request);
    pid_t pid = va_arg(list, pid_t);
    void *addr = va_arg(list, void *);
    void *data = va_arg(list, void *);
    va_end(list);

    if ((long)addr == NT_X86_XSTATE) {
        if (request == PTRACE_GETREGSET)
            return get_state(pid, addr, data);
        if (request == PTRACE_SETREGSET && ((struct iovec *)data)->iov_len < state_size)
            return set_state(pid, addr, data);
    }
    if (!next)
        next = (long (*)(int, pid_t, void *, void *))dlsym(RTLD_NEXT, "ptrace");
    return next(request, pid, addr, data);
}
