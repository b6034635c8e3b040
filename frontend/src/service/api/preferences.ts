/** Preferences of the signed-in person; the service stores them, so they are the same on every computer. */

import { queryOptions, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { createContext, useContext } from "react";
import { paintsInSoftware } from "../../drawing/canvas";
import type { AngleUnit } from "../../samples/quantity";
import { answered, api } from "../../wire/client";
import type { Preferences } from "../../wire/types";

const DEFAULTS: Preferences = {
  scheme: "auto",
  colours: {},
  hidden: [],
  layout: "Standard",
  layouts: [],
  clock: false,
  window_s: 20,
  statistics: false,
  solid: null,
  solid_unaided: null,
  camera: "Front",
  toured: false,
  notify: false,
  sound: false,
  angles: "deg",
};

export const preferencesQuery = queryOptions({
  queryKey: ["preferences"],
  queryFn: () => answered(api.GET("/api/preferences")),
  staleTime: Number.POSITIVE_INFINITY,
});

interface PreferencesInUse {
  /** Defaults until the service has answered. */
  readonly preferences: Preferences;
  readonly known: boolean;
  /** Applies a change at once, then stores it. A function computes the change from the current values; null for none. */
  change(part: Partial<Preferences> | ((before: Preferences) => Partial<Preferences> | null)): void;
}

export function usePreferences(): PreferencesInUse {
  const queries = useQueryClient();
  const { data } = useQuery(preferencesQuery);
  const store = useMutation({
    mutationFn: (body: Preferences) => answered(api.PUT("/api/preferences", { body })),
    scope: { id: "preferences" },
  });
  return {
    preferences: data ?? DEFAULTS,
    known: data !== undefined,
    change: (part) => {
      const before = queries.getQueryData(preferencesQuery.queryKey);
      // defaults must not overwrite preferences that the page has not loaded yet
      if (before === undefined) return;
      const changed = typeof part === "function" ? part(before) : part;
      if (changed === null) return;
      const after = { ...before, ...changed };
      queries.setQueryData(preferencesQuery.queryKey, after);
      store.mutate(after);
    },
  };
}

/** Unit of angles that the signed-in person chose; degrees until the service has answered. */
export const AngleUnitContext = createContext<AngleUnit>("deg");

export function useAngleUnit(): AngleUnit {
  return useContext(AngleUnitContext);
}

/** Whether the page shows the actuator in 3D, and from which camera; stored with the preferences. */

interface SceneView {
  readonly solid: boolean;
  readonly camera: string;
  /** False until the preferences are loaded: nothing can be changed until then. */
  readonly known: boolean;
  toggle(): void;
  look(camera: string): void;
}

/**
 * `byDefault` applies to a person who has not chosen. The 3D view runs in the page's thread: without a graphics
 * processor it would delay STOP, so computers without one have a separate choice.
 */
export function useSceneView(byDefault: boolean): SceneView {
  const { preferences, known, change } = usePreferences();
  const chosen = paintsInSoftware() ? "solid_unaided" : "solid";
  const solid = known && (preferences[chosen] ?? (byDefault && !paintsInSoftware()));
  return {
    solid,
    camera: preferences.camera,
    known,
    toggle: () => change({ [chosen]: !solid }),
    look: (camera) => change({ camera }),
  };
}
