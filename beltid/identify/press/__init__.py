"""Press test: force over travel to branches (`recording`) and the law of Eq. (3) (`stiffness`)."""
