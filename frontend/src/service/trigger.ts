/** The trigger: what is armed, in words, and the orders that arm and disarm it. */

import { useMutation, useQueryClient } from "@tanstack/react-query";
import { fixed } from "../samples/format";
import { answered, api } from "../wire/client";
import type { Trigger, TriggerOrder } from "../wire/types";
import { flightsQuery } from "./system";

export const CONDITIONS: readonly { readonly value: TriggerOrder["condition"]; readonly label: string }[] = [
  { value: "above", label: "above (level)" },
  { value: "below", label: "below (level)" },
  { value: "rising", label: "rising through (edge)" },
  { value: "falling", label: "falling through (edge)" },
  { value: "inside", label: "inside (window)" },
  { value: "outside", label: "outside (window)" },
];

export function isWindow(condition: TriggerOrder["condition"]): boolean {
  return condition === "inside" || condition === "outside";
}

/** What it does at present; quantities in SI, as the log has them. */
export function triggerWords(trigger: Trigger | null): string {
  if (trigger === null) return "Not armed";
  const made = `${trigger.captured} of ${trigger.captures} captured`;
  if (trigger.phase === "armed") return `Armed: ${trigger.says}; ${made}`;
  if (trigger.phase === "capturing") return `Recording: ${trigger.says}; ${fixed(trigger.left_s, 1)} s left`;
  return `Not armed: ${trigger.ended}; ${made}`;
}

export function useArm() {
  return useMutation({
    mutationFn: (body: TriggerOrder) => answered(api.PUT("/api/trigger", { body })),
  });
}

export function useDisarm() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.DELETE("/api/trigger")),
    onSuccess: () => queries.invalidateQueries({ queryKey: flightsQuery.queryKey }),
  });
}
