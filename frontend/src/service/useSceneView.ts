/** Whether a person sees the actuator in 3D, and from where: remembered for them, at every machine. */

import { paintsInSoftware } from "../drawing/canvas";
import { usePreferences } from "./preferences";

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
