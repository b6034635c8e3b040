/** Says once for each opening of the page how the wheel zooms. */

import { useCallback, useEffect, useState } from "react";

export const WHEEL_HINT = "Ctrl and wheel zoom the chart.";
const SHOWN_MS = 5000;

let told = false;

/** Whether the hint is in sight, and what asks for it. */
export function useWheelHint(): [boolean, () => void] {
  const [shown, show] = useState(false);
  const ask = useCallback(() => {
    if (told) return;
    told = true;
    show(true);
  }, []);
  useEffect(() => {
    if (!shown) return;
    const timer = window.setTimeout(() => show(false), SHOWN_MS);
    return () => window.clearTimeout(timer);
  }, [shown]);
  return [shown, ask];
}
