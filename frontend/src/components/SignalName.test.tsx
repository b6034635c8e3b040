import { render } from "@testing-library/react";
import { expect, it } from "vitest";
import { Written } from "./values";

it.each([
  ["theta_A_ref", "θA,ref"],
  ["lam_q", "λq"],
  ["q_ref", "qref"],
  ["F_A", "FA"],
  ["theta_A - theta_A_ref", "θA − θA,ref"],
])("writes %s as the paper does", (name, read) => {
  const { container } = render(<Written name={name} />);
  expect(container.textContent).toBe(read);
});
