/** Hooks for the layouts of the charts: the selected one, its panels, and edits, which are stored at once. */

import { useMemo } from "react";
import { fillText } from "../samples/texts";
import { useDerived } from "../service/api/formulas";
import { useAngleUnit, usePreferences } from "../service/api/preferences";
import type { ChartLayout, Preferences } from "../wire/types";
import { BUILT_IN_LAYOUTS, type Edited, MOST, panelsOf, readIn, STANDARD, unused } from "./layouts";
import { type Panel, signalOf } from "./signals";
import { TEXTS } from "./texts";

interface Layouts {
  readonly used: ChartLayout;
  readonly own: readonly ChartLayout[];
  choose(name: string): void;
  /** Edits the selected layout, or a copy of it if it is built in. Returns null, or the reason for a refusal. */
  edit(how: (used: ChartLayout) => Edited): string | null;
  /** Removes an own layout and selects the standard one. */
  remove(name: string): void;
}

export function useLayouts(): Layouts {
  const { preferences, change } = usePreferences();
  return {
    used: usedOf(preferences),
    own: preferences.layouts,
    choose: (name) => change({ layout: name }),
    edit: (how) => {
      let refusal: string | null = null;
      // Edits the latest preferences, because two presses may occur before the page renders again.
      change((before) => {
        const to = edited(before, how);
        if (typeof to !== "string") return to;
        refusal = to;
        return null;
      });
      return refusal;
    },
    remove: (name) =>
      change(({ layouts }) => ({
        layout: STANDARD.name,
        layouts: layouts.filter((one) => one.name !== name),
      })),
  };
}

function usedOf({ layout, layouts }: Preferences): ChartLayout {
  const selected = [...BUILT_IN_LAYOUTS, ...layouts].find(({ name }) => name === layout);
  const drawable = selected !== undefined && panelsOf(selected).some(({ over }) => over === undefined);
  return drawable ? selected : STANDARD;
}

/** Changes of the preferences, or the reason why there are none. */
function edited(before: Preferences, how: (used: ChartLayout) => Edited): Partial<Preferences> | string {
  const { layouts } = before;
  const used = usedOf(before);
  const to = how(used);
  if (typeof to === "string") return to;
  const isOwn = layouts.includes(used);
  const others = [...BUILT_IN_LAYOUTS, ...layouts]
    .filter((one) => one !== used || !isOwn)
    .map(({ name }) => name);
  if (isOwn) {
    if (others.includes(to.name)) return fillText(TEXTS.nameTaken, { name: to.name });
    return { layout: to.name, layouts: layouts.map((one) => (one === used ? to : one)) };
  }
  if (layouts.length >= MOST.layouts) return fillText(TEXTS.layoutsFull, { count: MOST.layouts });
  const name = unused(
    to.name === used.name ? fillText(TEXTS.copyOf, { layout: used.name }) : to.name,
    others,
  );
  return { layout: name, layouts: [...layouts, { ...to, name }] };
}

/** Panels of the selected layout, with the person's colours and units. */

export function usePanels(): readonly Panel[] {
  return useDrawn(useLayouts().used);
}

/** Panels of the standard layout, whose signals every recording contains. */
export function useStandardPanels(): readonly Panel[] {
  return useDrawn(STANDARD);
}

function useDrawn(layout: typeof STANDARD): readonly Panel[] {
  const { colours } = usePreferences().preferences;
  const angles = useAngleUnit();
  const derived = useDerived();
  // biome-ignore lint/correctness/useExhaustiveDependencies: drawn signals depend on the known derived ones
  return useMemo(
    () => panelsOf(layout).map((panel) => readIn(inColours(panel, colours), angles)),
    [layout, colours, angles, derived],
  );
}

function inColours(panel: Panel, colours: Readonly<Record<string, string>>): Panel {
  const traces = panel.traces.map((trace) => ({ ...trace, hue: colours[signalOf(trace.name)] ?? trace.hue }));
  return { ...panel, traces };
}
