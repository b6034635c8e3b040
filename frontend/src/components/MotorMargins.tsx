/** How robust the motor loops are at a λ_motor, as the service computes it of the sampled loop with L/R. */

import { useQuery } from "@tanstack/react-query";
import { motorMarginsQuery } from "../service/queries";
import { Explained } from "./Explained";
import { marginsText } from "./motorMargins";

interface MotorMarginsProps {
  readonly lam_motor: number;
  /** In force; null for gains from geometry. */
  readonly bank: number | null;
  readonly className?: string | undefined;
}

export function MotorMargins({ lam_motor, bank, className }: MotorMarginsProps) {
  const { data, error } = useQuery(motorMarginsQuery(lam_motor, bank));
  const words = error?.message ?? (data === undefined ? "…" : marginsText(data));
  return (
    <output className={className} aria-label="Motor loop">
      Motor loop at <Explained of="quantity:lam_motor">λ_motor</Explained> {lam_motor} s: {words}
    </output>
  );
}
