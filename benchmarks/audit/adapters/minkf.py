"""minkf: a Kalman filter of lists."""

import minkf

from benchmarks.audit.linear import Batch


class Kalman(Batch, kind="run_filter"):
    def filtered(self, z, H, R):
        out = minkf.run_filter(list(z), self.mean, self.cov, list(self.Fs), H, list(self.Qs), R)
        return out["x"][-1], out["C"][-1]
