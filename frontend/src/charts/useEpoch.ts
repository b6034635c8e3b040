import { useCallback } from "react";

/** The same function as long as the axis tells the same: time of day where there is one, else null. */
export function useEpoch(epoch_s: (() => number) | undefined): () => number | null {
  return useCallback(() => epoch_s?.() ?? null, [epoch_s]);
}
