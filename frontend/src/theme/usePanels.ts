/** The charts in the colours of the signed-in person. */

import { useMemo } from "react";
import { usePreferences } from "../service/preferences";
import { PANELS, type Panel, signalOf } from "./signals";

export function usePanels(): readonly Panel[] {
  const { colours } = usePreferences().preferences;
  return useMemo(() => PANELS.map((panel) => inColours(panel, colours)), [colours]);
}

function inColours(panel: Panel, colours: Readonly<Record<string, string>>): Panel {
  const traces = panel.traces.map((trace) => ({ ...trace, hue: colours[signalOf(trace.name)] ?? trace.hue }));
  return { ...panel, traces };
}
