/** The samples of a stored run as a source of curves, in more detail where the view has come to rest. */

import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo } from "react";
import { RecordedSource } from "../../charts/recordedSource";
import { stretch, type Viewport } from "../../charts/viewport";
import { significant } from "../../samples/format";
import type { Stretch } from "../../samples/stretch";
import { recordingQuery } from "../../service/queries";
import { PANELS } from "../../theme/signals";
import type { Excerpt } from "../../wire/curves";

/** What the charts show, and what the drawing of the actuator needs beside. */
const SIGNALS = [...PANELS.flatMap((panel) => panel.traces.map((trace) => trace.name)), "theta_A", "theta_B"];
const POINTS = 2000;
const RESTED_MS = 80;

export interface Recording {
  readonly source: RecordedSource;
  /** What a point of the curves stands for at present. */
  readonly resolution: string;
}

export function useRecording(run: number, duration_s: number, view: Viewport): Recording {
  const source = useMemo(() => new RecordedSource(duration_s), [duration_s]);
  const overview = useQuery(recordingQuery(run, { from_s: 0, to_s: duration_s }, POINTS, SIGNALS));
  const seen = stretch(view, duration_s);
  // the first turn of the wheel is followed at once, those after it when they have come to rest
  const wanted = useSteady(widened(seen, duration_s));
  const [rested] = useDebouncedValue(wanted, RESTED_MS, { leading: true });
  const zoomed = rested.to_s - rested.from_s < duration_s;
  const detail = useQuery({ ...recordingQuery(run, rested, 2 * POINTS, SIGNALS), enabled: zoomed });

  useEffect(() => {
    if (overview.data) source.setOverview(overview.data);
  }, [overview.data, source]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the stretch asked for with them
  useEffect(() => {
    if (detail.data && zoomed && !detail.isPlaceholderData) source.setDetail(rested, detail.data);
  }, [detail.data, source]);

  const fits =
    zoomed && rested.from_s <= Math.max(0, seen.from_s) && rested.to_s >= Math.min(seen.to_s, duration_s);
  return { source, resolution: resolution(fits ? detail.data : overview.data) };
}

/** The same object as long as it says the same: a new one would begin the wait for rest anew. */
function useSteady({ from_s, to_s }: Stretch): Stretch {
  return useMemo(() => ({ from_s, to_s }), [from_s, to_s]);
}

function resolution(shown: Excerpt | undefined): string {
  if (shown === undefined) return "loading";
  return shown.raw ? "every sample" : `smallest and largest per ${significant(shown.width_s, 3)} s`;
}

/** A third more on either side, so that a small pan needs no new data. */
function widened({ from_s, to_s }: Stretch, duration_s: number): Stretch {
  const margin = (to_s - from_s) / 3;
  return {
    from_s: Math.max(0, from_s - margin),
    to_s: Math.max(from_s, Math.min(duration_s, to_s + margin)),
  };
}
