/** What a tuning in hand would do, and whether the numbers at hand already belong to it. */

import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import type { Tuning, TuningPreview } from "../wire/types";
import { type PreviewRequest, previewQuery } from "./queries";

/** How long a value has to rest before it is asked for: a drag changes it with each frame. */
const AFTER_MS = 60;
/** How finely the stiffness of the preview follows the reference [N·m/rad], and a joint that has none. */
const COMMANDED_STEP = 0.01;
const MEASURED_STEP = 0.5;

export interface Previewed {
  readonly preview: TuningPreview | undefined;
  /** The numbers belong to an earlier value: those of this one are being computed. */
  readonly stale: boolean;
  /** Why there is no preview where there is none. */
  readonly missing: string;
}

export function usePreview(wanted: PreviewRequest, tuning: Tuning): Previewed {
  const key = JSON.stringify(wanted);
  const [asked] = useDebouncedValue(key, AFTER_MS);
  const query = useQuery(previewQuery(JSON.parse(asked) as PreviewRequest, restOf(tuning)));
  const stale = asked !== key || query.isPlaceholderData;
  if (query.error !== null && asked === key)
    return { preview: undefined, stale: false, missing: query.error.message };
  return { preview: query.data, stale: stale && query.data !== undefined, missing: "being computed" };
}

/** What a preview depends on beside its request: another one has another preview. */
function restOf({ lam_motor, b, interpolate, bank, entry }: Tuning): string {
  return [lam_motor, b, interpolate, bank?.id, Math.round(entry)].join(" ");
}

/** Stiffness that a preview is for: that of the reference, within its range; undefined before the first state. */
export function usePreviewedStiffness(): number | undefined {
  return useLive((live) => {
    if (live.state === null) return undefined;
    const { S_ref, in_force } = live.state.references;
    const { S_min, S_max } = live.state.limits;
    const step = in_force ? COMMANDED_STEP : MEASURED_STEP;
    return Math.min(Math.max(Number((Math.round((S_ref ?? S_min) / step) * step).toFixed(2)), S_min), S_max);
  });
}
