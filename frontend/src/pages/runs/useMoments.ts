/** Single samples around the playhead: a bucket of the curves in sight may be seconds long and has no one moment. */

import { useQuery } from "@tanstack/react-query";
import { useCallback, useMemo } from "react";
import type { PlotSource } from "../../charts/sources";
import { RecordedSource } from "../../charts/sources";
import { recordingQuery } from "../../service/queries";

const SIGNALS = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B"];
const BLOCK_S = 5;
/** More than a block has samples, so that each comes by itself. */
const POINTS = 6000;

/** How to read a signal at `at_s`; from the curves in sight until the samples have come. */
export function useMoments(
  run: number,
  at_s: number,
  duration_s: number,
  curves: PlotSource,
): (name: string, time_s: number) => number {
  const last = Math.max(0, Math.ceil(duration_s / BLOCK_S) - 1);
  const block = Math.min(Math.floor(at_s / BLOCK_S), last);
  const { data } = useQuery(recordingQuery(run, blockAt(block), POINTS, SIGNALS));
  // asked for ahead, so that playing does not stand at the end of a block
  useQuery(recordingQuery(run, blockAt(Math.min(block + 1, last)), POINTS, SIGNALS));
  const source = useMemo(() => {
    if (data === undefined) return curves;
    const samples = new RecordedSource(duration_s);
    samples.setOverview(data);
    return samples;
  }, [data, curves, duration_s]);
  return useCallback((name, time_s) => source.at(name, time_s), [source]);
}

function blockAt(block: number): { from_s: number; to_s: number } {
  return { from_s: block * BLOCK_S, to_s: (block + 1) * BLOCK_S };
}
