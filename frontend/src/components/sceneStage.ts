/** How far a 3D view has come, and what is said of it until there is a picture. */

/** What backend/scene/proxy.py writes on its document, in the order in which it comes; "dropped" by the browser. */
const TOLD = ["connecting", "drawing", "shown", "lost", "dropped"] as const;

/** Before its page is there, and when what came is not its page. */
export type Stage = (typeof TOLD)[number] | "page" | "failed";

/** Somebody who has waited so long is told so [s]. */
export const PATIENCE_S = 20;

const AWAITED = {
  page: "its page from the service",
  connecting: "the scene from the service",
  drawing: "the browser to draw it",
};

export const NO_3D =
  "This browser cannot draw in 3D: it has no WebGL 2. Press Show flat, or allow graphics in the browser's settings.";

/** The stage that the document in a frame tells; another document than the view's, as the browser's own, tells none. */
export function stageIn(frame: HTMLIFrameElement): Stage {
  const told = frame.contentDocument?.documentElement.dataset.stage;
  return TOLD.find((stage) => stage === told) ?? "failed";
}

/** Empty once there is a picture. `software`: the browser paints without a graphics processor. */
export function sceneWords(stage: Stage, late: boolean, software: boolean): string {
  switch (stage) {
    case "shown":
      return "";
    case "failed":
      return "The 3D view failed: its page did not come from the service.";
    case "lost":
      return "The 3D view is cut off from the service: the actuator stands as it was then. It connects again by itself.";
    case "dropped":
      return "The browser has stopped drawing the 3D view: the actuator stands as it was then, or is not seen.";
  }
  if (late) return `The 3D view has waited for ${AWAITED[stage]} for more than ${PATIENCE_S} s.`;
  const slow =
    stage === "drawing" && software ? ", which takes some seconds without a graphics processor" : "";
  return `The 3D view is loading: it waits for ${AWAITED[stage]}${slow}.`;
}
