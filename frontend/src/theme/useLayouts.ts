/** The layouts of the charts that a person may choose, and their own ones; each change is kept at once. */

import { usePreferences } from "../service/preferences";
import type { ChartLayout } from "../wire/types";
import { MOST, panelsOf, READY, STANDARD, unused } from "./layouts";

interface Layouts {
  readonly used: ChartLayout;
  readonly own: readonly ChartLayout[];
  choose(name: string): void;
  /** Change the layout in use; of one that comes with the page a copy is made. Null when it is kept, or why it is not. */
  change(to: ChartLayout): string | null;
  /** Take an own layout away; the standard one is used after it. */
  remove(name: string): void;
}

export function useLayouts(): Layouts {
  const { preferences, change } = usePreferences();
  const { layout, layouts } = preferences;
  const all = [...READY, ...layouts];
  const wanted = all.find(({ name }) => name === layout);
  const used =
    wanted !== undefined && panelsOf(wanted).some(({ over }) => over === undefined) ? wanted : STANDARD;
  return {
    used,
    own: layouts,
    choose: (name) => change({ layout: name }),
    change: (to) => {
      const isOwn = layouts.includes(used);
      const others = all.filter((one) => one !== used || !isOwn).map(({ name }) => name);
      if (isOwn) {
        if (others.includes(to.name)) return `There is a layout “${to.name}” already; choose another name.`;
        change({ layout: to.name, layouts: layouts.map((one) => (one === used ? to : one)) });
        return null;
      }
      if (layouts.length >= MOST.layouts)
        return `${MOST.layouts} own layouts are kept at most; remove one first.`;
      const copy = { ...to, name: unused(to.name === used.name ? `My ${used.name}` : to.name, others) };
      change({ layout: copy.name, layouts: [...layouts, copy] });
      return null;
    },
    remove: (name) => change({ layout: STANDARD.name, layouts: layouts.filter((one) => one.name !== name) }),
  };
}
