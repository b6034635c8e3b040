/** Card with names and values in two columns. */

import type { ReactNode } from "react";
import { Card } from "../../components/Card";
import page from "../Page.module.css";
import { TEXTS } from "./texts";

interface FactsProps {
  readonly title: string;
  readonly facts: readonly (readonly [string, ReactNode])[];
  readonly children?: ReactNode;
}

export function Facts({ title, facts, children }: FactsProps) {
  return (
    <Card title={title}>
      <dl className={page.facts}>
        {facts.map(([name, value]) => (
          <div key={name} style={{ display: "contents" }}>
            <dt>{name}</dt>
            <dd>{value ?? TEXTS.unknown}</dd>
          </div>
        ))}
      </dl>
      {children}
    </Card>
  );
}
