/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Loaded in front of the C library (LD_PRELOAD): every wait for the disk takes as long as SLOW_DISK_S says, in seconds,
 * and is then done as usual. What an SD card at its worst does, on any machine.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdlib.h>
#include <time.h>

static int slowly(const char *name, int descriptor)
{
	int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, name);
	const char *word = getenv("SLOW_DISK_S");
	double seconds = word ? atof(word) : 0.0;
	struct timespec left = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};

	while (nanosleep(&left, &left) != 0 && errno == EINTR)
		;
	return real(descriptor);
}

int fsync(int descriptor)
{
	return slowly("fsync", descriptor);
}

int fdatasync(int descriptor)
{
	return slowly("fdatasync", descriptor);
}
