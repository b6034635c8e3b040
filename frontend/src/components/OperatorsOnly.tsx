/** What only an operator may use: a viewer is not offered it. */

import type { ReactNode } from "react";
import { useMayCommand } from "../service/useMayCommand";

export function OperatorsOnly({
  children,
  otherwise = null,
}: {
  children: ReactNode;
  otherwise?: ReactNode;
}) {
  return useMayCommand() === false ? otherwise : children;
}
