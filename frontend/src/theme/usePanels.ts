/** The charts of the layout in use, in the colours and the units of the signed-in person; live, of a recording, compared. */

import { useMemo } from "react";
import { useAngles, usePreferences } from "../service/preferences";
import { useDerived } from "../service/signals";
import { panelsOf, readIn, STANDARD } from "./layouts";
import { type Panel, signalOf } from "./signals";
import { useLayouts } from "./useLayouts";

export function usePanels(): readonly Panel[] {
  return useDrawn(useLayouts().used);
}

/** The charts that every record has the signals of. */
export function useStandardPanels(): readonly Panel[] {
  return useDrawn(STANDARD);
}

function useDrawn(layout: typeof STANDARD): readonly Panel[] {
  const { colours } = usePreferences().preferences;
  const angles = useAngles();
  const derived = useDerived();
  // biome-ignore lint/correctness/useExhaustiveDependencies: which signals there are decides which are drawn
  return useMemo(
    () => panelsOf(layout).map((panel) => readIn(inColours(panel, colours), angles)),
    [layout, colours, angles, derived],
  );
}

function inColours(panel: Panel, colours: Readonly<Record<string, string>>): Panel {
  const traces = panel.traces.map((trace) => ({ ...trace, hue: colours[signalOf(trace.name)] ?? trace.hue }));
  return { ...panel, traces };
}
