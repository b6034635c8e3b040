/** A short piece of a curve, as the chart draws it. */

import { dashOf, paintOf, type Trace } from "../theme/signals";

export function TraceLine({ trace }: { trace: Trace }) {
  return (
    <svg width="18" height="8" aria-hidden="true">
      <line
        x1="0"
        x2="18"
        y1="4"
        y2="4"
        stroke={paintOf(trace.hue)}
        strokeWidth="2.5"
        strokeDasharray={dashOf(trace).join(" ") || undefined}
      />
    </svg>
  );
}
