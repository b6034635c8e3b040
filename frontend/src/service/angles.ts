/** The unit in which the signed-in person reads angles, for whatever shows or takes one. */

import { createContext, useContext } from "react";
import type { Angles } from "../samples/quantity";

/** Degrees until the service has said what the person chose. */
export const AnglesContext = createContext<Angles>("deg");

export function useAngles(): Angles {
  return useContext(AnglesContext);
}
