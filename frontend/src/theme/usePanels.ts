/** The charts in the colours and the units of the signed-in person. */

import { useMemo } from "react";
import { useAngles } from "../service/angles";
import { usePreferences } from "../service/preferences";
import { PANELS, type Panel, readIn, signalOf } from "./signals";

export function usePanels(): readonly Panel[] {
  const { colours } = usePreferences().preferences;
  const angles = useAngles();
  return useMemo(() => PANELS.map((panel) => readIn(inColours(panel, colours), angles)), [colours, angles]);
}

function inColours(panel: Panel, colours: Readonly<Record<string, string>>): Panel {
  const traces = panel.traces.map((trace) => ({ ...trace, hue: colours[signalOf(trace.name)] ?? trace.hue }));
  return { ...panel, traces };
}
