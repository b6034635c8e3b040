/** Hooks for the layouts of the charts: the one in use, its panels, and changes, which are stored at once. */

import { useMemo } from "react";
import { fillText } from "../samples/texts";
import { useDerived } from "../service/api/formulas";
import { useAngleUnit, usePreferences } from "../service/api/preferences";
import type { ChartLayout, Preferences } from "../wire/types";
import { type Edited, MOST, panelsOf, READY, readIn, STANDARD, unused } from "./layouts";
import { type Panel, signalOf } from "./signals";
import { TEXTS } from "./texts";

interface Layouts {
  readonly used: ChartLayout;
  readonly own: readonly ChartLayout[];
  choose(name: string): void;
  /** Change the layout in use; of one that comes with the page a copy is made. Null when it is kept, or why it is not. */
  edit(how: (used: ChartLayout) => Edited): string | null;
  /** Take an own layout away; the standard one is used after it. */
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
      // of what is in force now: two presses may come before the page is rendered once
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
  const wanted = [...READY, ...layouts].find(({ name }) => name === layout);
  const drawable = wanted !== undefined && panelsOf(wanted).some(({ over }) => over === undefined);
  return drawable ? wanted : STANDARD;
}

/** What changes in the preferences, or why nothing does. */
function edited(before: Preferences, how: (used: ChartLayout) => Edited): Partial<Preferences> | string {
  const { layouts } = before;
  const used = usedOf(before);
  const to = how(used);
  if (typeof to === "string") return to;
  const isOwn = layouts.includes(used);
  const others = [...READY, ...layouts].filter((one) => one !== used || !isOwn).map(({ name }) => name);
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

/** The charts of the layout in use, in the colours and the units of the signed-in person; live, of a recording, compared. */

export function usePanels(): readonly Panel[] {
  return useDrawn(useLayouts().used);
}

/** The charts that every record has the signals of. */
export function useStandardPanels(): readonly Panel[] {
  return useDrawn(STANDARD);
}

function useDrawn(layout: typeof STANDARD): readonly Panel[] {
  const { colours } = usePreferences().preferences;
  const angles = useAngleUnit();
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
