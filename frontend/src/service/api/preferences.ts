/** How the signed-in person likes the page; stored by the service, so that it is the same at every machine. */

import { queryOptions, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { createContext, useContext } from "react";
import { paintsInSoftware } from "../../drawing/canvas";
import type { AngleUnit } from "../../samples/quantity";
import { answered, api } from "../../wire/client";
import type { Preferences } from "../../wire/types";

/** How the signed-in person likes the page; kept on the server, so that it is the same at every machine. */

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
  /** In force at once; the service is told behind. What follows from what is in force is a function of it, null for none. */
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
      // what is not known yet must not be overwritten by defaults
      if (before === undefined) return;
      const changed = typeof part === "function" ? part(before) : part;
      if (changed === null) return;
      const after = { ...before, ...changed };
      queries.setQueryData(preferencesQuery.queryKey, after);
      store.mutate(after);
    },
  };
}

/** The unit in which the signed-in person reads angles, for whatever shows or takes one. */

/** Degrees until the service has said what the person chose. */
export const AngleUnitContext = createContext<AngleUnit>("deg");

export function useAngleUnit(): AngleUnit {
  return useContext(AngleUnitContext);
}

/** Whether a person sees the actuator in 3D, and from where: remembered for them, at every machine. */

interface SceneView {
  readonly solid: boolean;
  readonly camera: string;
  /** False until it is known what the person chose before: nothing can be changed until then. */
  readonly known: boolean;
  toggle(): void;
  look(camera: string): void;
}

/**
 * `byDefault` is what somebody sees who never chose. The 3D view shares the page's thread: what was chosen where there
 * is a graphics processor does not count where there is none, for it would hold up STOP there.
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
